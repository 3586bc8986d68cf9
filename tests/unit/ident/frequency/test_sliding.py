"""Sliding mean and gain: exact cases, coverage of the bands on stationary records, and drift that is found."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from made_narx import trajectory_of
from scipy.signal import lfilter
from scipy.stats import binom, t

from deatwin.ident.frequency.varying.short_time import BANDS, compare_windows, series_error, short_time, windows_of
from deatwin.ident.frequency.varying.sliding import SlidingStatus, sliding_mean_and_gain
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.varying_systems import CONSTANT, VARYING
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

LONG = 400  # samples in which all filters below forget


def record(rng, n, *, gain=1.0, offset=2.0):
    """u first order, y = first order of u, plus coloured noise; gain and offset may change along the record."""
    u = lfilter([1.0], [1, -0.5], rng.normal(size=n + LONG))
    y = lfilter([0.0, 0.3], [1, -0.9], u) + lfilter([0.3], [1, -0.8], rng.normal(size=n + LONG))
    return Recording.from_arrays(u[LONG:], offset + gain * y[LONG:], 0.1, start=5.0)


@pytest.mark.parametrize(("offset", "step", "rel"), [(2.0, None, 1e-9), (1e4, 0.7, 1e-8), (1e4, 25.0, 1e-8)])
def test_mean_and_gain_are_those_of_each_window(offset, step, rel):
    """Far from zero readings are rounded to 1e-12 of their scatter."""
    given = record(np.random.default_rng(0), 3000 if step is None else 1000, offset=offset)
    found = sliding_mean_and_gain(given, 50.0, step_s=step)
    for k, middle in enumerate(found.timepts):
        rows = np.abs(given.timepts - middle) < 25.0
        u, y = given.inputs[0, rows], given.outputs[0, rows]
        assert rows.sum() == 500
        assert found.mean[k] == pytest.approx(y.mean(), rel=1e-12)
        # The jackknife written out: without a tenth, without the next one, ...
        whole = np.log(y.std() / u.std())
        tenths = np.arange(500) // 50
        without = np.array([np.log(y[tenths != i].std() / u[tenths != i].std()) for i in range(10)])
        assert np.log(found.gain[k]) == pytest.approx(10 * whole - 9 * without.mean(), rel=rel)
        error = np.sqrt(0.9 * np.sum((without - without.mean()) ** 2))
        wider = np.sqrt((1 + found.gain_correlation) / (1 - found.gain_correlation))
        half = np.log(found.gain_high[k] / found.gain_low[k]) / 2
        assert half == pytest.approx(t.ppf(0.975, 9) * error * wider, rel=10 * rel if step else rel)


def test_what_does_not_drift_is_seldom_said_to():
    # Two tests at 1 %: 4 of 200 on average, and 12 or more in less than 0.1 % of cases; 6 of each p below 5 % more.
    rng = np.random.default_rng(2)
    found = [sliding_mean_and_gain(record(rng, 6000), 100.0) for _ in range(200)]
    assert sum(one.status is SlidingStatus.DRIFTING for one in found) <= 12
    for name in ("p_mean", "p_gain"):
        assert sum(getattr(one, name) < 0.05 for one in found) <= binom.ppf(0.9999, 200, 0.05)


@pytest.mark.parametrize(
    "drift",
    [
        {"gain": np.linspace(1.0, 2.0, 10000)},
        {"offset": np.linspace(2.0, 5.0, 10000)},
        {"offset": 2.0 + 2.0 * (np.arange(10000) > 3000)},
    ],
    ids=["gain", "mean", "jump"],
)
def test_drift_is_found(drift):
    # In a window of 200 s the standard error of the mean is 0.14, that of the logarithmic gain 0.045: the five windows
    # differ from their mean by more than 4 of these (rms), so that the ratio of variances is near 20, far above the 3.8
    # of the 1 % test with 4 and 45 degrees of freedom. All of 20 records are told.
    rng = np.random.default_rng(3)
    for _ in range(20):
        found = sliding_mean_and_gain(record(rng, 10000, **drift), 200.0)
        assert found.status is SlidingStatus.DRIFTING
        assert (found.p_gain if "gain" in drift else found.p_mean) < 0.01


def test_windows_that_are_too_short_say_so():
    # Batches of one second, in which y forgets only half: bands that pretend to know are announced.
    rng = np.random.default_rng(4)
    found = [sliding_mean_and_gain(record(rng, 6000), 10.0) for _ in range(20)]
    assert all(one.status is SlidingStatus.SHORT and not one.status.ok for one in found)
    one = sliding_mean_and_gain(record(rng, 1000), 100.0)
    assert one.status is SlidingStatus.FEW and np.isnan(one.p_mean)


def test_units_change_nothing_but_the_units():
    given = record(np.random.default_rng(5), 4000)
    found = sliding_mean_and_gain(given, 100.0)
    other = sliding_mean_and_gain(
        Recording.from_arrays(1e-3 * given.inputs, 1e6 * given.outputs, 0.1, start=5.0), 100.0
    )
    np.testing.assert_allclose(other.gain_low, 1e9 * found.gain_low, rtol=1e-10)
    np.testing.assert_allclose(other.mean_high, 1e6 * found.mean_high, rtol=1e-10)
    assert other.p_gain == pytest.approx(found.p_gain, rel=1e-6) and other.status is found.status


def test_an_input_that_stands_still_has_no_gain():
    given = record(np.random.default_rng(6), 4000)
    u = given.inputs.copy()
    u[:, :1500] = 1.0
    found = sliding_mean_and_gain(Recording.from_arrays(u, given.outputs, 0.1), 100.0, step_s=100.0)
    assert np.isnan(found.gain[0]) and np.isfinite(found.gain[2:]).all() and np.isfinite(found.mean).all()
    still = Recording.from_arrays(np.sin(np.arange(4000.0)), np.full(4000, 2.0), 0.1)
    assert np.isnan(sliding_mean_and_gain(still, 100.0).p_gain)
    assert sliding_mean_and_gain(still, 100.0).p_mean == 1.0


@pytest.mark.parametrize("still", ["input", "output"])
def test_a_gain_that_cannot_be_judged_is_said_to(still):
    # 0.1 has no exact mean in binary numbers: rounding is not taken for motion.
    given, flat = record(np.random.default_rng(9), 6000), np.full(6000, 0.1)
    signals = (flat, given.outputs) if still == "input" else (given.inputs, flat)
    found = sliding_mean_and_gain(Recording.from_arrays(*signals, 0.1), 100.0)
    assert np.isnan(found.gain).all() and np.isnan(found.p_gain)
    assert found.status is SlidingStatus.STILL and not found.status.ok


def test_many_windows_need_little_memory():
    """Of 200 000 samples, a window each 10: all windows side by side would be 160 MB, and so would every copy."""
    rng = np.random.default_rng(11)
    given = Recording.from_arrays(rng.normal(size=200_000), rng.normal(size=200_000), 0.01)
    tracemalloc.start()
    found = sliding_mean_and_gain(given, 10.0, step_s=0.1)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.gain.size == 19901
    assert most < 80e6


def test_plot_and_dataset():
    given = record(np.random.default_rng(7), 4000)
    found = sliding_mean_and_gain(given, 100.0, level=0.9)
    top, bottom = found.plot()
    assert (top.get_ylabel(), bottom.get_ylabel()) == ("mean displacement (m)", "gain (m/V)")
    assert bottom.get_xlabel() == "time (s)"
    assert [text.get_text() for text in top.get_legend().get_texts()] == ["windows of 100 s", "90 % band"]
    data = found.to_xarray()
    np.testing.assert_array_equal(data.gain, found.gain)
    assert data.gain.units == "m/V" and data.attrs["level"] == 0.9


def test_what_cannot_be():
    given = record(np.random.default_rng(8), 1000)
    for window in (0.5, 200.0, np.nan, -1.0):
        with pytest.raises(DataError, match="must lie between 4 s"):
            sliding_mean_and_gain(given, window)
    for step in (0.0, -1.0, np.inf):
        with pytest.raises(DataError, match="at least the sample time"):
            sliding_mean_and_gain(given, 50.0, step_s=step)
    with pytest.raises(ModelError, match="between 0 and 1"):
        sliding_mean_and_gain(given, 50.0, level=95)
    with pytest.raises(DataError, match="a ndarray is not a recording"):
        sliding_mean_and_gain(np.ones(400), 50.0)
    with pytest.raises(ModelError, match="window_s must be real numbers; got text"):
        sliding_mean_and_gain(given, "a")
    with pytest.raises(ModelError, match="step_s must be one number"):
        sliding_mean_and_gain(given, 50.0, step_s=[1.0, 2.0])
    with pytest.raises(DataError, match="2 inputs and 1 outputs"):
        sliding_mean_and_gain(Recording.from_arrays(np.ones((2, 1000)), np.arange(1000.0), 0.1), 50.0)


STEP = 0.12


def test_a_window_is_seen_as_its_hann_weighted_transform() -> None:
    values = np.random.default_rng(3).standard_normal(64) + 5.0
    weights = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)
    expected = np.fft.rfft(weights * (values - values.mean())) / weights.sum()
    frequencies, found = short_time(values, 0.1)
    np.testing.assert_allclose(frequencies, np.fft.rfftfreq(64, 0.1))
    np.testing.assert_allclose(np.abs(found), np.abs(expected), atol=1e-14)
    tone = 3.0 * np.cos(2 * np.pi * 8 * np.arange(64) / 64)
    assert np.abs(short_time(tone, 0.1)[1][8]) == pytest.approx(1.5)


def test_a_periodic_recording_is_predicted_exactly() -> None:
    model = NarxModel.from_terms(
        {"1": 1e-5, "y(k-1)": 0.6, "u(k)": 2e-5, "u(k)u(k-1)": 1e-5, "u(k)^3": 3e-6, "u(k-1)^5": 1e-7}, sample_time=STEP
    )
    period = 2.4 + 0.5 * np.random.default_rng(4).standard_normal(166)
    long = Recording.from_arrays(np.tile(period, 12), np.zeros(12 * 166), STEP)
    steady = model.simulate(long).outputs[0]
    record = replace(long, outputs=steady[None]).section(6 * 166, 12 * 166)
    n = 6 * 166
    trajectory = trajectory_of(model, record.timepts, np.repeat(model.theta[:, None], n, axis=1))
    windows = windows_of(record, 166 * STEP)
    assert len(windows) == 11 and windows[1].start == pytest.approx(windows[0].start + 83 * STEP)
    found = compare_windows(windows, {CONSTANT: model, VARYING: trajectory}, 2.4)
    for way in (CONSTANT, VARYING):
        for band in BANDS:
            assert found.error(way, band) < 1e-9
            np.testing.assert_allclose(found.power_ratio_dB(way, band), 0.0, atol=1e-8)
    assert series_error(trajectory, windows[0], 2.4) < 1e-9
    doubled = replace(found, predicted={VARYING: 2 * found.recorded})
    np.testing.assert_allclose(doubled.power_ratio_dB(VARYING, BANDS[0]), 6.0206, atol=1e-4)
    assert doubled.error(VARYING, BANDS[0]) == pytest.approx(1.0)
