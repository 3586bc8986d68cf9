"""Drifts and roughness of signals whose answer is known."""

from typing import Any

import numpy as np
import pytest

from deatwin.ident.drifts import at_same_input, fast_part, gain_change, mean_shift, moving_mean, roughness
from deatwin.plant.errors import DataError
from deatwin.plant.excitation import band_limited_noise

STEP = 0.02


def noise(seed: int, duration: float = 300.0) -> np.ndarray:
    return band_limited_noise(np.random.default_rng(seed), duration, STEP)


def test_moving_mean_is_a_convolution() -> None:
    values = np.random.default_rng(0).standard_normal(101)
    mean = moving_mean(values, 11)
    np.testing.assert_allclose(mean[5:-5], np.convolve(values, np.full(11, 1 / 11), "valid"))
    assert np.isnan(mean[:5]).all() and np.isnan(mean[-5:]).all()


def test_a_shift_is_found_with_its_error() -> None:
    u = noise(3)
    curve, sensor = 1e-4 * u**3, 1e-5 * np.random.default_rng(103).standard_normal(u.size)
    moved = curve + sensor + np.where(STEP * np.arange(u.size) < 150, 0.0, -2e-5)
    shift = mean_shift(u, moved, STEP, (0, 100), (200, 300))
    assert shift.size == pytest.approx(-2e-5, abs=4 * shift.error)
    assert shift.significance < -3
    # White noise of 10 µm leaves 10 / sqrt(5000) µm in each mean; 20 blocks tell that to 16 %, three times allowed.
    assert shift.error == pytest.approx(1e-5 * np.sqrt(2 / 5000), rel=0.5)
    still = mean_shift(u, curve + sensor, STEP, (0, 100), (200, 300))
    assert abs(still.significance) < 4


def test_what_command_and_rate_explain_is_taken_off() -> None:
    u = noise(4)
    y = 1e-4 * u**2 + 2e-6 * np.gradient(u, STEP)
    assert at_same_input(u, y, STEP).std() < 1e-3 * y.std()


def test_changes_of_gain_and_of_nonlinearity_are_told_apart() -> None:
    u = noise(5)
    late = STEP * np.arange(u.size) >= 150
    sensor = 1e-6 * np.random.default_rng(105).standard_normal(u.size)
    rest = 1e-4 * u**2
    windows: Any = ((0, 150), (150, 300))
    scaled = gain_change(u, rest * np.where(late, 0.8, 1.0) + sensor, STEP, *windows)
    assert scaled.gain == pytest.approx(-0.2, abs=0.01)
    assert abs(scaled.bend) < max(4 * scaled.bend_error, 0.01)
    # Another law: 2 c u at each command becomes 3 d u², so the ratio of slopes at 3 V and 2 V goes from 1.5 to 2.25.
    bent = gain_change(u, np.where(late, 0.25e-4 * u**3, rest) + sensor, STEP, *windows)
    assert bent.bend == pytest.approx(0.5, abs=0.1)


def test_roughness_is_the_rms_of_what_is_fast_there() -> None:
    timepts = STEP * np.arange(3000)
    slow = 0.45e-3 + 1e-4 * np.sin(2 * np.pi * 0.5 * timepts)
    buzz = 1e-5 * np.sin(2 * np.pi * 12.0 * timepts) * (timepts > 20) * (timepts < 40)
    here, later = (roughness(slow + buzz, STEP, w, (0.4e-3, 0.5e-3)) for w in ((22, 38), (45, 58)))
    assert here == pytest.approx(1e-5 / np.sqrt(2), rel=0.05)
    assert later < 1e-7
    assert np.abs(fast_part(slow, STEP)[100:-100]).max() < 1e-8
    with pytest.raises(DataError, match="no reading"):
        roughness(slow, STEP, (0, 10), (1e-3, 2e-3))
