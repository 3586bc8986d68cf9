"""The sensor's noise is the data sheet's, unless the top of the spectrum says more."""

import numpy as np
import pytest

from deatwin.ident.mismatch.noise import noise_floor

NOISE = 2e-6


def residual(seed: int, slow: float, n: int = 6000) -> np.ndarray:
    """White noise of the sensor and a slow sine of that rms."""
    timepts = 0.02 * np.arange(n)
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    return noise + slow * np.sqrt(2) * np.sin(2 * np.pi * 0.031 * timepts)


def test_noise_floor_keeps_the_data_sheet_where_it_is_right():
    assert noise_floor([residual(0, 3e-6)], 0.02, NOISE) == NOISE


def test_noise_floor_sees_a_noisier_sensor():
    seen = noise_floor([1.8 * residual(0, 3e-6)], 0.02, NOISE)
    # the median of 5 Hz of a Welch spectrum of 6000 samples scatters by about 5 %
    assert seen == pytest.approx(1.8 * NOISE, rel=0.15)
