"""Closed forms and sums of orders against settled free runs."""

import numpy as np
import pytest
from numpy.typing import NDArray

from deatwin.ident.frequency import gfrf
from deatwin.ident.frequency.closed_forms import DUFFING, HAMMERSTEIN, LINEAR, QUADRATIC, ClosedForm
from deatwin.ident.frequency.output_responses.settled import in_bands, left_by_orders
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet import OPERATING_INPUT

PERIOD = 60
"""Samples of the probing tones."""


def tones(lines: tuple[int, ...], size: float) -> NDArray[np.float64]:
    time = np.arange(PERIOD)
    return np.asarray(size * sum(np.cos(2 * np.pi * line * time / PERIOD) for line in lines))


@pytest.mark.parametrize(
    ("system", "lines"),
    [
        (LINEAR, (7,)),
        (HAMMERSTEIN, (3,)),
        (HAMMERSTEIN, (3, 8)),
        (HAMMERSTEIN, (1, 4, 12)),
        (QUADRATIC, (5,)),
        (QUADRATIC, (3, 8)),
        (QUADRATIC, (1, 4, 12)),
        (QUADRATIC, (1, 3, 9, 16)),
        (DUFFING, (5,)),
        (DUFFING, (1, 4, 12)),
    ],
)
def test_closed_forms_are_the_responses_of_their_models(system: ClosedForm, lines: tuple[int, ...]) -> None:
    """Which simulated tones are answered with: tests/validation/test_gfrf_probing.py."""
    omega = 2 * np.pi * np.array([lines]) / PERIOD
    found = gfrf(system.model, len(lines), omega[:, 0] if len(lines) == 1 else omega, operating_input=0.0).values
    np.testing.assert_allclose(system.responses[len(lines)](omega), found, rtol=1e-11)


def test_a_series_that_ends_and_one_that_does_not() -> None:
    inputs = tones((2, 5), 0.5)
    ends = NarxModel.from_terms({"y(k-1)": 0.5, "u(k)": 1.0, "u(k-1)^2": 1.0, "u(k)^3": 1.0}, sample_time=1.0)
    endless = NarxModel.from_terms({"y(k-1)": 0.5, "u(k)": 1.0, "y(k-1)u(k)": 0.1}, sample_time=1.0)
    left = [left_by_orders(model, inputs, 8, OPERATING_INPUT) for model in (ends, endless)]
    assert left[0][1] > 1e-3 and left[0][2:].max() < 1e-13
    # Of the bilinear one each order is at most |0.1 w / (1 - 0.74)| of the one before: it converges, and does not end.
    assert np.all(np.diff(np.log(left[1])) < np.log(0.4)) and left[1][-1] > 1e-12


def test_lines_in_bands() -> None:
    lines = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    assert in_bands(lines, np.array([[0.1, 0.2], [0.4, 0.5]])).tolist() == [False, True, True, False, True]
