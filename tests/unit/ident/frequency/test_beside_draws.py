"""Propagated covariances beside draws that are off by a known factor."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from deatwin.ident.frequency import gfrf
from deatwin.ident.frequency.uncertainty.beside_draws import Spread, departure, spread_of, whitened
from deatwin.ident.narx import NarxModel


def test_departure_of_covariances() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    reference = (turn @ np.diag([4.0, 0.01]) @ turn.T)[None]
    # 20 % less along the short axis is what counts, however short it is.
    other = (turn @ np.diag([4.2, 0.008]) @ turn.T)[None]
    assert departure(reference, other) == pytest.approx(0.2)
    np.testing.assert_allclose(np.linalg.eigvalsh(whitened(reference, other)), [[0.8, 1.05]])
    flat = (turn @ np.diag([4.0, 0.0]) @ turn.T)[None]
    assert departure(flat, 1.1 * flat) == pytest.approx(0.1)


def drawn(model: NarxModel, scale: float, seed: int) -> Spread:
    """Draws of a response that is linear in its parameters, from a covariance that is off by a factor."""
    omega = 2 * np.pi * np.linspace(0.02, 0.4, 10)
    found = spread_of("case", model, partial(gfrf, order=1, omega=omega), np.random.default_rng(seed))
    draws = found.sampled.values + scale * (found.sampled.draws - found.sampled.values)
    return replace(found, sampled=replace(found.sampled, draws=draws))


def test_a_covariance_that_is_off_is_seen() -> None:
    # b1 z^-1 + b2 z^-2 is linear in its parameters: the law is exact, and the band holds with a probability of 99 %.
    theta_cov = np.array([[1e-4, 5e-5], [5e-5, 4e-4]])
    model = replace(NarxModel.from_terms({"u(k-1)": 1.0, "u(k-2)": 0.5}, sample_time=1.0), theta_cov=theta_cov)
    right = drawn(model, 1.0, 0)
    assert right.strict.all() and right.largest < right.allowed
    assert right.held == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 20_000))
    # A variance 6 % too large is 6 % over sqrt(2/20000), 6 of its standard errors; the band is 3.6 of them wide.
    wrong = drawn(model, np.sqrt(1.06), 0)
    assert wrong.largest > wrong.allowed > 3
    assert wrong.ratio == pytest.approx(1.06, abs=0.05)
