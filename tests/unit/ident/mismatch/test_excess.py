"""A mismatch needs more than noise and more than model error."""

import numpy as np
import pytest

from deatwin.ident.mismatch.excess import excess_of

NOISE = 2e-6


def residual(seed: int, slow: float, n: int = 6000) -> np.ndarray:
    """White noise of the sensor and a slow sine of that rms."""
    timepts = 0.02 * np.arange(n)
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    return noise + slow * np.sqrt(2) * np.sin(2 * np.pi * 0.031 * timepts)


@pytest.mark.parametrize("slow", [0.0, 0.8e-6])
def test_less_than_the_model_error_is_no_mismatch(slow):
    # 0.8 µm is significant against noise alone: a sixth more energy in 6000 samples is nine standard deviations
    for seed in range(20):
        assert not excess_of(residual(seed, slow), NOISE, 1.2e-6).mismatch


def test_more_than_the_model_error_is_a_mismatch():
    for seed in range(20):
        found = excess_of(residual(seed, 2.4e-6), NOISE, 1.2e-6)
        assert found.mismatch
        assert found.size == pytest.approx(2.4e-6, rel=0.1)


def test_an_explanation_may_leave_the_part_of_a_loud_noise_that_no_mismatch_has():
    """Beside 10 µm of noise 1 µm is a hundredth of the power: by as much the noise's own power scatters."""
    found = [excess_of(5.0 * residual(seed, 0.0), 5.0 * NOISE, 1e-6) for seed in range(40)]
    assert all(one.within_error and not one.mismatch for one in found)
    slow = [excess_of(5.0 * residual(seed, 1.2e-6), 5.0 * NOISE, 1e-6) for seed in range(40)]
    assert not any(one.within_error for one in slow)  # 6 µm; a tenth of the power is 3.2
