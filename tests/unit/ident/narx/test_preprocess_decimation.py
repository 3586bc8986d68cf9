"""The sampling time by correlation functions whose minima are known, and decimation that keeps the timing."""

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.narx.preprocess import SamplingStatus, choose_sampling, decimate, removed_share
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime


def of(y, sample_time=0.01):
    return Recording.from_arrays(np.zeros(len(y)), y, sample_time)


def test_first_minima_of_a_sinusoid():
    # r(tau) = cos(2 pi tau / 240): first minimum at 120; the square has half the period: at 60
    y = 3.0 + np.sin(2 * np.pi * np.arange(24000) / 240 + 0.3)
    found = choose_sampling(of(y), n_lags=1000)
    assert (found.linear_minimum, found.nonlinear_minimum, found.first_minimum) == (120, 60, 60)
    assert found.factor == 4 and found.status is SamplingStatus.DECIMATE  # 60 / 15
    lags = np.arange(1001)
    # the sums of n - tau products are over n: (1 - tau/n) cos, and end effects of order period / n
    np.testing.assert_allclose(found.linear, (1 - lags / 24000) * np.cos(2 * np.pi * lags / 240), atol=0.01)


def test_first_minima_of_resonant_noise():
    # y(k) = 2 r cos(w) y(k-1) - r^2 y(k-2) + e: rho follows the same recursion from rho(0) = 1 and
    # rho(1) = 2 r cos(w) / (1 + r^2); for a normal process the correlation of the squares is rho^2
    # (Isserlis), whose first minimum is the first zero of rho.
    r, w = 0.98, 0.1
    a = [1.0, -2 * r * np.cos(w), r**2]
    rho = [1.0, 2 * r * np.cos(w) / (1 + r**2)]
    while len(rho) < 100:
        rho.append(-a[1] * rho[-1] - a[2] * rho[-2])
    linear = int(np.argmin(rho))
    nonlinear = int(np.argmax(np.array(rho) < 0))
    y = lfilter([1.0], a, np.random.default_rng(0).normal(size=200_000))
    found = choose_sampling(of(y), n_lags=300)
    assert found.linear_minimum == pytest.approx(linear, abs=2)  # 30
    assert found.nonlinear_minimum == pytest.approx(nonlinear, abs=3)  # 15 or 16, and flat there
    np.testing.assert_allclose(found.linear[:60], rho[:60], atol=4 * found.linear_band / 1.96)
    assert found.status is SamplingStatus.KEEP and found.factor == 1


@pytest.mark.parametrize(
    ("period", "status", "factor"),
    [(12, SamplingStatus.TOO_SLOW, 1), (60, SamplingStatus.KEEP, 1), (1200, SamplingStatus.DECIMATE, 20)],
)
def test_advice(period, status, factor):
    found = choose_sampling(of(np.sin(2 * np.pi * np.arange(20000) / period)), n_lags=2000)
    assert (found.status, found.factor) == (status, factor)


def test_the_highest_frequency_keeps_ten_samples_a_period():
    # a slow tone asks for a factor of 20; a mode of 3 % of its size, with 60 samples a period, allows 6
    k = np.arange(20000)
    slow, mode = np.sin(2 * np.pi * k / 1200), 0.03 * np.sin(2 * np.pi * k / 60)
    found = choose_sampling(of(slow + mode), n_lags=2000)
    assert found.highest == pytest.approx(100 / 60, rel=0.01) and found.factor in (5, 6)
    fast = choose_sampling(of(slow + 0.03 * np.sin(2 * np.pi * k / 5)), n_lags=2000)
    assert (fast.factor, fast.status) == (1, SamplingStatus.FAST_PART)


def test_white_noise_is_no_fast_part():
    # at most 3 of 50 are to be taken for one
    tone, rng = np.sin(2 * np.pi * np.arange(4000) / 1200), np.random.default_rng(7)
    found = [choose_sampling(of(tone + 0.1 * rng.normal(size=4000)), n_lags=900).highest for _ in range(50)]
    assert sum(one > 0.5 for one in found) <= 3


def test_no_minimum_is_said():
    found = choose_sampling(of(np.linspace(0.0, 1.0, 4000) ** 3), n_lags=200)
    assert found.status is SamplingStatus.NO_MINIMUM and found.factor == 1


def test_several_recordings_count_together():
    rng = np.random.default_rng(1)
    parts = [of(lfilter([1.0], [1, -1.9, 0.95], rng.normal(size=n))) for n in (3000, 5000)]
    found = choose_sampling(parts, n_lags=100)
    y = [part.outputs[0] - np.concatenate([p.outputs[0] for p in parts]).mean() for part in parts]
    for lag in (0, 1, 7, 50):
        by_hand = sum(float(x[lag:] @ x[: x.size - lag]) for x in y) / sum(float(x @ x) for x in y)
        assert found.linear[lag] == pytest.approx(by_hand, abs=1e-12)


@pytest.mark.parametrize("factor", [2, 3, 5, 8])
@pytest.mark.parametrize("reading", [ReadingTime.START_OF_HOLD, ReadingTime.END_OF_HOLD])
def test_the_timing_of_inputs_and_readings(factor, reading):
    # A row's input is held over the row: its middle counts. A row's reading is taken at the end, or the start.
    T, start, omega = 0.01, 3.0, 2 * np.pi * 1.0
    late = 1.0 if reading is ReadingTime.END_OF_HOLD else 0.0
    t = start + T * np.arange(4000)
    fine = Recording.from_arrays(
        np.sin(omega * (t + T / 2)),
        np.cos(omega * (t + late * T)),
        T,
        start=start,
        extras={"current": np.sin(omega * (t + late * T))},
    )
    coarse = decimate(fine, factor, reading=reading)
    new, held = coarse.timepts, coarse.sample_time
    assert held == pytest.approx(factor * T)
    # the filter of 60 dB passes 1 Hz with a ripple of at most 1e-3, and without phase
    np.testing.assert_allclose(coarse.inputs[0], np.sin(omega * (new + held / 2)), atol=1.1e-3)
    np.testing.assert_allclose(coarse.outputs[0], np.cos(omega * (new + late * held)), atol=1.1e-3)
    np.testing.assert_allclose(coarse.extras["current"], np.sin(omega * (new + late * held)), atol=1.1e-3)
    # the clock is that of the old rows, and about nine new samples are left out at each end
    on_grid = (new - start) / T / factor
    np.testing.assert_allclose(on_grid, np.round(on_grid), atol=1e-9)
    assert 9 <= (new[0] - start) / held <= 12 and 9 <= (t[-1] - new[-1]) / held <= 12
    assert coarse.provenance["decimated"] == f"by {factor}, from 0.01 s"


def test_what_would_alias_is_removed():
    n, factor = 6000, 4
    slow = np.sin(2 * np.pi * 0.02 * np.arange(n))
    # new Nyquist frequency 0.125 a sample; from 0.15 on the filter stops, 60 dB
    fast = np.sin(2 * np.pi * 0.17 * np.arange(n))
    both = Recording.from_arrays(slow, slow + fast, 1.0)
    alone = Recording.from_arrays(slow, slow, 1.0)
    np.testing.assert_allclose(decimate(both, factor).outputs, decimate(alone, factor).outputs, atol=1.1e-3)
    share = removed_share(both, factor)
    assert share["displacement"] == pytest.approx(0.5, abs=0.01) and share["command"] < 1e-5


def test_factor_one_is_the_recording_itself():
    recording = of(np.arange(10.0))
    assert decimate(recording, 1) is recording


def test_plot_shows_both_functions():
    axes = choose_sampling(of(np.sin(np.arange(4000) / 30))).plot()
    assert axes.get_xlabel() == "lag (s)" and len(axes.get_legend().get_texts()) == 2
    assert "decimate by" in axes.get_title()


def test_what_is_too_short_to_decimate_has_no_share_and_no_mean():
    """Of 60 samples no variance could be computed after a filter of 75, which was given as a share of 0."""
    short = Recording.from_arrays(np.arange(60.0) % 7, np.arange(60.0) % 5, 0.1)
    for act in (lambda: removed_share(short, 4), lambda: decimate(short, 4)):
        with pytest.raises(
            DataError, match="60 samples are too few to decimate by 4: the filter alone is 75 samples long"
        ):
            act()
    with pytest.raises(DataError, match="60 samples are too few to decimate by 100"):
        decimate(short, 100, reading=ReadingTime.MEAN_OVER_HOLD)
    for factor in (1, 0, -1, 1.5, None, "2"):
        with pytest.raises(DataError, match=r"factor = .*; it must be an integer of at least 2"):
            removed_share(short, factor)
