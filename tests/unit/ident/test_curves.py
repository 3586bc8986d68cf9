"""Curves, loops and spectra of signals whose answer is known."""

import numpy as np
import pytest

from deatwin.ident.curves import linear_share, local_gain, loop_area, mean_curve, straight_line
from deatwin.plant.errors import DataError
from deatwin.plant.excitation import band_limited_noise

STEP = 0.02


def noise(seed: int, duration: float = 300.0) -> np.ndarray:
    return band_limited_noise(np.random.default_rng(seed), duration, STEP)


def test_a_line_through_the_lower_half_of_a_parabola() -> None:
    # Least squares through x² from 0 to 1 is x - 1/6: it misses by 1/6 at the ends, of a stroke of 4.
    x = np.linspace(0.0, 2.0, 20_001)
    line = straight_line(x, x**2, below=1.0)
    assert line.gain == pytest.approx(1.0, abs=1e-3)
    assert line.offset == pytest.approx(-1 / 6, abs=1e-3)
    assert line.misfit == pytest.approx(1 / 24, rel=1e-3)
    with pytest.raises(DataError, match="at least three"):
        straight_line(x, x, below=0.0)


def test_local_gain_is_the_slope_of_a_parabola() -> None:
    x = np.linspace(1.0, 4.0, 500)
    assert local_gain(x, 3 * x**2 - x, 2.0) == pytest.approx(11.0, rel=1e-9)
    with pytest.raises(DataError, match="samples within"):
        local_gain(x, x, 9.0)


def test_mean_curve_averages_what_one_command_gave() -> None:
    levels = np.repeat([1.0, 2.0, 3.0], [100, 100, 10])
    readings = 2 * levels + np.tile([-0.5, 0.5], 105)
    found = mean_curve(levels, readings)
    np.testing.assert_allclose(found, [[1.0, 2.0], [2.0, 4.0]])  # ten samples are too few for a point


@pytest.mark.parametrize("cycles", [1, 3])
def test_area_of_a_loop_of_two_sines(cycles: int) -> None:
    phase = 2 * np.pi * np.arange(1000 * cycles) / 1000 - np.pi / 2
    for lag in (0.3, 0.0, -0.3):
        found = loop_area(2.4 + np.sin(phase), 5e-4 * np.sin(phase - lag))
        assert found == pytest.approx(np.pi / 4 * np.sin(lag), abs=1e-4)


def test_a_linear_plant_has_no_power_beyond_the_linear_model() -> None:
    u = noise(0)
    y = np.convolve(u - u.mean(), np.exp(-np.arange(200) / 10.0))[: u.size]
    _, output, explained = linear_share(u, y, STEP, width=0.1).above(1.0)
    assert explained == pytest.approx(output, rel=0.05)


def test_powers_above_a_frequency_are_those_of_parseval() -> None:
    u = noise(1)
    of_input = linear_share(u, u, STEP).above(0.0)[0]
    assert of_input == pytest.approx(u.var(), rel=1e-3)  # but for the line at half the sample rate


def test_a_square_has_power_that_no_linear_model_makes() -> None:
    # The reference is another estimate: a response of 401 taps by least squares, in the time domain.
    u = noise(2)
    y = (u - 1.0) ** 2
    share = linear_share(u, y, STEP)
    _, output, explained = share.above(1.0)
    assert output > 5 * explained
    taps = 200
    rows = np.lib.stride_tricks.sliding_window_view(np.pad(u - u.mean(), taps, mode="wrap"), 2 * taps + 1)
    gram = rows.T @ rows + 1e-6 * u.size * np.eye(2 * taps + 1)
    made = rows @ np.linalg.solve(gram, rows.T @ (y - y.mean()))
    _, by_taps, _ = linear_share(u, made, STEP).above(1.0)
    assert output > 5 * by_taps


def test_a_short_record_is_refused() -> None:
    with pytest.raises(DataError, match="need at least 80 s"):
        linear_share(noise(0, 20.0), noise(1, 20.0), STEP)
