"""The counting of evidence, under laws that are known."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import stdtr

from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain, evidence, exceeds
from deatwin.ident.mismatch.thresholds import BLOCK_SAMPLES


def coloured(rng: np.random.Generator, n: int) -> np.ndarray:
    """Unit white noise plus a slow component, of total variance two."""
    return lfilter([np.sqrt(1 - 0.95**2)], [1.0, -0.95], rng.standard_normal(n)) + rng.standard_normal(n)


def test_blocks_keep_the_energy_and_short_records_still_make_eight():
    residual = np.arange(500, dtype=float)
    assert block_losses(residual).mean() == pytest.approx(np.mean(residual**2))
    assert block_losses(residual).size == 500 // BLOCK_SAMPLES
    assert block_losses(np.ones(40)).size == 8


def test_a_residual_at_the_floor_is_rarely_called_a_mismatch():
    rng = np.random.default_rng(0)
    p_values = np.array([exceeds(block_losses(coloured(rng, 6000)), 2.0) for _ in range(300)])
    # at a level of 1 % three of 300 are expected; a mean of 120 skewed blocks is allowed four times that
    assert (p_values < 0.01).sum() <= 12
    # and the test is no dead letter: about half of the p-values lie below a half
    assert 0.35 < (p_values < 0.5).mean() < 0.65


@pytest.mark.parametrize("n", [60, 120, 300, 900])
def test_a_short_record_at_the_floor_is_rarely_called_a_mismatch(n):
    rng = np.random.default_rng(n)
    p_values = np.array([exceeds(block_losses(rng.standard_normal(n)), 1.0) for _ in range(1000)])
    # at a level of 1 %; few skewed blocks are allowed three times that, where the normal law makes five to seven
    assert (p_values < 0.01).sum() <= 30


def test_a_residual_above_the_floor_is_found():
    rng = np.random.default_rng(1)
    p_values = [exceeds(block_losses(coloured(rng, 6000)), 1.5) for _ in range(50)]
    # a third more energy than the floor, 120 blocks: found in at least nine of ten
    assert np.mean(np.array(p_values) < 0.01) >= 0.9


def test_the_variance_of_a_mean_is_the_quadratic_form_of_the_window_and_never_negative():
    """Losses with a period at which the window's transform vanishes leave hardly any variance."""
    rng, count, lags = np.random.default_rng(5), 8, 2
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    window = np.maximum(1.0 - apart / (lags + 1), 0.0)
    for _ in range(50):
        losses = (
            1.0 + 0.6 * np.cos(2 * np.pi * np.arange(count) / 3 + rng.uniform(0, 6)) + 0.06 * rng.normal(size=count)
        )
        centred = losses - losses.mean()
        deviation = np.sqrt(centred @ window @ centred) / count
        floor = losses.mean() - 0.01
        expected = stdtr(1.5 * count / (lags + 1), -0.01 / deviation)
        assert exceeds(losses, floor) == pytest.approx(expected, rel=1e-6)


def test_evidence_prefers_fewer_parameters_at_equal_losses():
    losses = np.ones(100)
    assert evidence(losses, 7) - evidence(losses, 9) == pytest.approx(np.log(100))


def test_gain_has_the_right_sign_and_a_lower_bound():
    rng = np.random.default_rng(2)
    before, after = rng.chisquare(50, 200) / 50 * 4, rng.chisquare(50, 200) / 50
    gain = bootstrap_gain(before, after, np.random.default_rng(3))
    assert 0.9 < gain < 1.0  # the true fall of the rms is 2 - 1
    assert bootstrap_gain(after, before, np.random.default_rng(3)) < -0.9
    assert bootstrap_gain(before, before, np.random.default_rng(3)) == 0.0
