"""Where commands come back, and what comes back with them."""

import tracemalloc

import numpy as np
import pytest

from deatwin.ident.mismatch.quality.repeats import find_repeats, repeatability

STEP, NOISE = 0.02, 2e-6


def command(rng: np.random.Generator, n: int) -> np.ndarray:
    return 2.4 + np.convolve(rng.standard_normal(n + 40), np.hanning(41), mode="valid")


def test_periods_are_paired_with_their_next_return():
    one = command(np.random.default_rng(0), 500)
    found = find_repeats([np.tile(one, 4)], STEP)
    np.testing.assert_array_equal(found.second - found.first, 500)
    # three of four periods come back; the first second of the stretch is left to settle
    assert found.first.size == 3 * 500 - 50


def test_a_stretch_is_found_in_another_recording():
    rng = np.random.default_rng(1)
    shared, (a, b, c) = command(rng, 400), (command(rng, 300) for _ in range(3))
    found = find_repeats([np.r_[a, shared, b], np.r_[c, shared]], STEP)
    assert found.first[0] == 300 + 50
    assert found.first[-1] == 300 + 399
    np.testing.assert_array_equal(found.second - found.first, 1000 + 300 - 300)


def test_what_never_comes_back_has_no_repeats():
    rng = np.random.default_rng(2)
    assert find_repeats([command(rng, 3000)], STEP) is None
    assert find_repeats([np.full(3000, 2.0)], STEP) is None
    # a hold is the same command at every shift of itself; that is no repeat
    assert find_repeats([np.repeat([1.0, 2.0, 3.0], 1000)], STEP) is None


def test_fast_sampling_invents_no_repeats_and_loses_none():
    """At 1 kHz neighbouring windows are nearly alike, and there are many of them."""
    rng = np.random.default_rng(4)
    once = np.convolve(rng.standard_normal(16_000), np.hanning(1000) / 20, mode="valid")
    assert find_repeats([once], 1e-3) is None
    ramp = np.abs(np.arange(30_000) / 15_000 - 1.0)
    assert find_repeats([ramp], 1e-3) is None
    found = find_repeats([np.r_[once[:10_000], once[:10_000]]], 1e-3)
    np.testing.assert_array_equal(found.second - found.first, 10_000)
    assert found.first.size == 10_000 - 1000


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_share_that_comes_back_is_found(share):
    """Part of the excess is a function of the place in the period, the other is drawn anew."""
    inside, shares = [], []
    found = find_repeats([np.tile(command(np.random.default_rng(0), 500), 6)], STEP)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        own, foreign = (x / x.std() for x in (rng.standard_normal(500), rng.standard_normal(3000)))
        excess = 4e-6 * (np.sqrt(share) * np.tile(own, 6) + np.sqrt(1 - share) * foreign)
        seen = repeatability(NOISE * rng.standard_normal(3000) + excess, found, NOISE)
        inside.append(seen.low <= share <= seen.high)
        shares.append(seen.share)
    # correlations of some 2450 pairs scatter by 0.02 a record, so that their mean over 100 does by 0.003 at most
    assert np.mean(shares) == pytest.approx(share, abs=0.01)
    assert np.mean(inside) >= 0.75  # two standard deviations of a jackknife over neighbouring pairs: 85 to 95 %


def test_the_explainable_share_is_what_is_left_by_the_variance_within():
    rng = np.random.default_rng(3)
    found = find_repeats([np.tile(command(rng, 500), 10)], STEP)
    residual = np.tile(3e-6 * rng.standard_normal(500), 10) + 2e-6 * rng.standard_normal(5000)
    # 9 of 13 parts of the variance repeat; 500 of them are drawn once, so that they scatter by 6 %
    assert repeatability(residual, found, NOISE).explainable == pytest.approx(9 / 13, rel=0.08)


def test_windows_of_many_samples_are_not_held_in_memory():
    """At 1 kHz a window has 2000 samples: all windows of 30,000 samples would take 480 MB, thirty arrays of them 7 MB."""
    count = 30_000
    tracemalloc.start()
    find_repeats([np.random.default_rng(1).standard_normal(count)], 1e-3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30 * 8 * count
