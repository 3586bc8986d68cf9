"""Excitation signals: noise, sweeps, holds, and what is done to any signal."""

from math import comb, factorial

import numpy as np
import pytest
import scipy.integrate
import scipy.signal
import scipy.stats
from numpy.polynomial.hermite_e import HermiteE

from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    logarithmic_chirp,
    random_holds,
    share_above_band,
    staircase,
    triangles,
    with_alternating_polarity,
)

SAMPLE_TIME = 0.02


class TestBandLimitedNoise:
    def test_before_the_limits_mean_and_variance_are_exact(self) -> None:
        command = band_limited_noise(np.random.default_rng(1), 240.0, SAMPLE_TIME, lower=-50.0, upper=50.0)
        assert command.shape == (12000,)
        assert command.mean() == pytest.approx(2.4, abs=1e-12)
        assert command.var() == pytest.approx(0.36, rel=1e-12)


def clipped_gaussian_in_theory(lower: float, upper: float) -> tuple[float, float]:
    """Variance of a clipped standard Gaussian process of a flat band, and its share above the band.

    Price's theorem: the clipped process has the autocorrelation sum c_k² ρ^k, with c_k the coefficients of the
    clipping in normalised Hermite polynomials. ρ^k has as its spectrum the k-fold convolution of the band's box
    with itself, of which the Irwin-Hall distribution says how much lies within the band.
    """

    def coefficient(k: int) -> float:  # by parts: E[g He_k] = E[g' He_(k-1)], and g' is 1 between the limits
        if k == 1:
            return scipy.stats.norm.cdf(upper) - scipy.stats.norm.cdf(lower)
        ends = [scipy.stats.norm.pdf(x) * HermiteE.basis(k - 2)(x) for x in (lower, upper)]
        return (ends[0] - ends[1]) / np.sqrt(float(factorial(k)))

    def within(k: int) -> float:  # P(|sum of k uniform on (-1, 1)| < 1), in whole numbers until the last step
        def below(x2: int) -> int:  # 2^k k! P(sum of k uniform on (0, 1) < x2 / 2)
            return sum((-1) ** j * comb(k, j) * (x2 - 2 * j) ** k for j in range(k + 1) if x2 > 2 * j)

        return (below(k + 1) - below(k - 1)) / (2**k * factorial(k))

    def moment(power: int) -> float:
        inside = scipy.integrate.quad(lambda x: x**power * scipy.stats.norm.pdf(x), lower, upper)[0]
        below, above = scipy.stats.norm.cdf(lower), scipy.stats.norm.sf(upper)
        return inside + below * lower**power + above * upper**power

    variance = moment(2) - moment(1) ** 2
    in_band = sum(coefficient(k) ** 2 * within(k) for k in range(1, 100))  # the rest is below 1e-5
    return variance, 1.0 - in_band / variance


class TestShareAboveBand:
    @pytest.mark.parametrize(("lower", "upper"), [(1.1, 3.75), (2.0, 3.0)])
    def test_clipping_moves_the_share_that_theory_says(self, lower: float, upper: float) -> None:
        variance, share = clipped_gaussian_in_theory((lower - 2.4) / 0.6, (upper - 2.4) / 0.6)
        signals = [
            band_limited_noise(np.random.default_rng(seed), 1100.0, SAMPLE_TIME, lower=lower, upper=upper)
            for seed in range(30)
        ]
        shares = np.array([share_above_band(signal, SAMPLE_TIME, 1.0) for signal in signals])
        variances = np.array([signal.var() for signal in signals])
        # four standard errors of the mean over independent signals, and what is left out of the sum
        assert abs(shares.mean() - share) < 4.0 * shares.std(ddof=1) / np.sqrt(30) + 1e-5
        assert abs(variances.mean() - 0.36 * variance) < 4.0 * variances.std(ddof=1) / np.sqrt(30)
        assert 4.0 * shares.std(ddof=1) / np.sqrt(30) < 0.15 * share  # or the test would say nothing

    def test_lines_are_shared_out_by_their_power(self) -> None:
        t = np.arange(500) * SAMPLE_TIME
        signal = 5.0 + 3.0 * np.sin(2 * np.pi * t) + 1.0 * np.cos(2 * np.pi * 4.0 * t)
        assert share_above_band(signal, SAMPLE_TIME, 2.0) == pytest.approx(0.1, rel=1e-12)
        assert share_above_band(signal, SAMPLE_TIME, 4.0) < 1e-25  # the band's end belongs to the band

    @pytest.mark.parametrize("n", [8, 9])
    def test_the_line_at_half_the_sample_rate_counts_once(self, n: int) -> None:
        noise = np.random.default_rng(2).standard_normal(n)
        spectrum = np.abs(scipy.signal.periodogram(noise, return_onesided=True, detrend="constant")[1])
        above = np.fft.rfftfreq(n) > 0.3
        assert share_above_band(noise, 1.0, 0.3) == pytest.approx(spectrum[above].sum() / spectrum.sum(), rel=1e-12)


class TestChirps:
    def test_linear_is_scipys(self) -> None:
        t = np.arange(3000) * SAMPLE_TIME
        expected = 2.4 + 0.3 * scipy.signal.chirp(t, 5.0, 60.0, 15.0, phi=-90.0)
        np.testing.assert_allclose(linear_chirp(60.0, SAMPLE_TIME), expected, atol=1e-9)

    @pytest.mark.parametrize(("first", "last"), [(0.1, 10.0), (10.0, 0.1)])
    def test_logarithmic_is_scipys(self, first: float, last: float) -> None:
        t = np.arange(6000) * SAMPLE_TIME
        expected = 2.0 + 0.5 * scipy.signal.chirp(t, first, 120.0, last, method="logarithmic", phi=-90.0)
        np.testing.assert_allclose(logarithmic_chirp(120.0, SAMPLE_TIME, first, last, 2.0, 0.5), expected, atol=1e-9)


class TestRandomHolds:
    def test_holds_and_levels_are_in_range(self) -> None:
        command = random_holds(np.random.default_rng(7), 400.0, SAMPLE_TIME, 1.1, 3.75)
        assert command.shape == (20000,)
        assert 1.1 <= command.min() < 1.6 and 3.2 < command.max() <= 3.75
        holds = np.diff(np.flatnonzero(np.diff(command, prepend=np.nan))) * SAMPLE_TIME
        assert holds.min() >= 2.0 - 1e-9 and holds.max() <= 25.0 + 1e-9


class TestStaircase:
    def test_levels_and_holds(self) -> None:
        command = staircase(SAMPLE_TIME, 1.0, 3.0, levels=3, hold=10.0)
        assert command.shape == (2500,)
        np.testing.assert_array_equal(
            command.reshape(5, 500), np.repeat([[1.0], [2.0], [3.0], [2.0], [1.0]], 500, axis=1)
        )


class TestTriangles:
    def test_each_rate_goes_up_and_down_in_a_straight_line(self) -> None:
        command = triangles(SAMPLE_TIME, 1.0, 3.0, rates=(1e-3, 0.1), cycles=2)
        assert command.shape == (2 * 50000 + 2 * 500,)
        slow, fast = command[:50000], command[100000:100500]
        np.testing.assert_array_equal(command[50000:100000], slow)
        assert slow[0] == 1.0 and slow[25000] == 3.0 and fast[250] == 3.0
        np.testing.assert_allclose(np.diff(slow[:25001]), 2.0 * 2e-3 * SAMPLE_TIME, rtol=1e-9)  # 2 V in half 1/f
        np.testing.assert_allclose(np.diff(fast[250:]), -2.0 * 0.2 * SAMPLE_TIME, rtol=1e-9)

    def test_at_half_the_sample_rate_it_goes_to_and_fro(self) -> None:
        np.testing.assert_array_equal(triangles(SAMPLE_TIME, 1.0, 3.0, rates=(25.0,), cycles=2), [1.0, 3.0, 1.0, 3.0])


class TestRearranged:
    def test_polarity_changes_by_whole_segments(self) -> None:
        signal = np.arange(1.0, 8.0)
        np.testing.assert_array_equal(with_alternating_polarity(signal, 0.5, 1.0), [1, 2, -3, -4, 5, 6, -7])
