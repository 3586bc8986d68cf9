"""Findings: planted faults are named with their size and place, clean noise is left alone, nothing is altered."""

from collections import Counter

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.narx.preprocess import FindingKind, inspect_recordings
from deatwin.plant.recording import Recording

T = 0.02


def smooth(rng, n, pole=0.9):
    return lfilter([1.0], [1.0, -pole], rng.normal(size=n + 200))[200:]


def record(change=lambda y: y, n=6000, seed=0):
    """A micrometre-sized output that follows a smooth command, with white noise of 0.2 µm."""
    rng = np.random.default_rng(seed)
    u = smooth(rng, n)
    y = 1e-6 * lfilter([0.5], [1, -0.5], u) + 0.2e-6 * rng.normal(size=n)
    return Recording.from_arrays(u, change(y), T, start=100.0, provenance={"file": "a.csv"})


def named(recording):
    return {(finding.signal, finding.kind): finding for finding in inspect_recordings(recording)}


def with_values(where, values):
    def change(y):
        y = y.copy()
        y[where] = values(y) if callable(values) else values
        return y

    return change


def test_clean_records_have_no_findings_beyond_the_stated_rate():
    # normal noise, white and coloured: each kind and signal fires with probability 0.01. Of 300 records at most
    # 300 * 0.01 + 3 sqrt(3) = 8.2 for each; the F test of the drift is approximate, and may have half as many again.
    rng = np.random.default_rng(1)
    counts = Counter()
    for number in range(300):
        pole = (0.0, 0.5, 0.9)[number % 3]
        recording = Recording.from_arrays(smooth(rng, 3000, pole), smooth(rng, 3000, pole), T)
        counts.update((f.signal, f.kind) for f in inspect_recordings(recording))
    assert {kind for _, kind in counts} <= {FindingKind.TREND, FindingKind.DRIFT, FindingKind.OUTLIERS}
    assert counts and max(counts.values()) <= 12


def test_a_trend_is_named_with_its_size():
    found = named(record(lambda y: y + np.linspace(0.0, 5e-6, y.size)))
    trend = found["displacement", FindingKind.TREND]
    # chance gives the 6000 samples, of spectral density (10 µm)^2 at zero, a trend of 10 µm sqrt(12/6000) = 0.45 µm
    assert trend.size == pytest.approx(5e-6, abs=4 * 0.45e-6) and trend.unit == "m"
    assert (trend.from_s, trend.to_s) == (100.0, pytest.approx(100.0 + 5999 * T))
    assert str(trend).startswith("a.csv, displacement: a linear trend of ")
    assert trend.recording == "a.csv" and "linear trend of" in trend.text and "µm over 120 s" in trend.text
    assert ("command", FindingKind.TREND) not in found


def test_a_drift_that_is_no_trend_is_named_with_its_place():
    def shift(y):
        return y + 3e-6 * np.exp(-(((np.arange(y.size) - 3000) / 400) ** 2))

    drift = named(record(shift))["displacement", FindingKind.DRIFT]
    assert drift.from_s <= 100.0 + 3000 * T <= drift.to_s + 600 * T and drift.size > 1e-6


def test_steps_and_ringing_are_no_outliers():
    # commands held for 4 s, answered by a mode that rings with 6 samples a period
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1, 1, 30), 200)
    mode = np.poly([0.9 * np.exp(1j), 0.9 * np.exp(-1j)]).real
    y = lfilter([mode.sum()], mode, u) + 0.002 * rng.normal(size=u.size)
    kinds = {finding.kind for finding in inspect_recordings(Recording.from_arrays(u, y, T))}
    assert FindingKind.OUTLIERS not in kinds
    y[3150] += 0.1
    assert FindingKind.OUTLIERS in {finding.kind for finding in inspect_recordings(Recording.from_arrays(u, y, T))}


def test_what_recurs_in_each_period_is_no_outlier():
    # A cube makes sharp peaks of a multisine, the same in each of four periods; one reading is disturbed.
    rng = np.random.default_rng(3)
    lines = np.zeros(129, dtype=complex)
    lines[1:60] = np.exp(2j * np.pi * rng.random(59))
    u = np.tile(np.fft.irfft(lines, 256), 4)
    peaks = np.zeros(256)
    peaks[[70, 181]] = 4.0, -3.0
    y = lfilter([0.3], [1.0, -0.7], u / u.std()) + np.tile(peaks, 4) + 0.02 * rng.normal(size=u.size)
    assert ("displacement", FindingKind.OUTLIERS) not in named(Recording.from_arrays(u, y, T))
    y[600] += 4.0
    assert named(Recording.from_arrays(u, y, T))["displacement", FindingKind.OUTLIERS].count == 1


def test_a_coarse_resolution_is_named_and_a_fine_one_is_not():
    coarse = named(record(lambda y: np.round(y / 1e-6) * 1e-6))["displacement", FindingKind.QUANTISATION]
    assert coarse.size == pytest.approx(1e-6, rel=1e-9) and "steps of 1 µm" in coarse.text
    # steps of 0.1 µm add (0.1/0.2)^2 / 12 = 2 % to the variance of the noise
    fine = named(record(lambda y: np.round(y / 1e-7) * 1e-7))
    assert ("displacement", FindingKind.QUANTISATION) not in fine


def test_noise_that_the_steps_hide_is_not_said_to_be_zero():
    coarse = named(record(lambda y: np.round(y / 5e-6) * 5e-6))["displacement", FindingKind.QUANTISATION]
    assert "hide the noise" in coarse.text and "0 m rms" not in coarse.text


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_clipping_is_named_with_its_level(sign):
    found = named(record(lambda y: sign * np.minimum(y, 2.5e-6)))
    clipped = found["displacement", FindingKind.CLIPPING]
    assert clipped.size == pytest.approx(sign * 2.5e-6) and clipped.count >= 10
    assert f"{'largest' if sign > 0 else 'smallest'} value, {sign * 2.5:.3g} µm" in clipped.text
    assert not any(kind is FindingKind.CONSTANT for _, kind in found)


def test_a_stuck_reading_is_named_with_its_place():
    found = named(record(with_values(slice(2000, 2060), lambda y: y[2000])))
    stuck = found["displacement", FindingKind.CONSTANT]
    assert (stuck.from_s, stuck.to_s) == (pytest.approx(140.0), pytest.approx(100.0 + 2059 * T))
    assert stuck.count == 60 and "while the input moves" in stuck.text


def test_a_rest_is_not_stuck():
    recording = record()
    u, y = recording.inputs.copy(), recording.outputs.copy()
    u[:, 3000:3300], y[:, 3000:3300] = u[0, 3000], 1e-6 * 0.123
    assert not any(f.kind is FindingKind.CONSTANT for f in inspect_recordings(Recording.from_arrays(u, y, T)))


def test_a_dead_channel_is_named():
    dead = Recording.from_arrays(np.random.default_rng(3).normal(size=500), np.full(500, 2e-3), T)
    (found,) = inspect_recordings(dead)
    assert found.kind is FindingKind.CONSTANT and "2 mm throughout" in found.text


def test_nothing_is_altered_and_units_change_nothing():
    recording = record(lambda y: y + np.linspace(0.0, 2e-6, y.size))
    before = recording.outputs.copy()
    plain = inspect_recordings(recording)
    np.testing.assert_array_equal(recording.outputs, before)
    other = Recording.from_arrays(recording.inputs * 2.0**9, recording.outputs * 2.0**30, T, start=100.0)
    assert [(f.kind, f.signal, f.count) for f in inspect_recordings(other)] == [
        (f.kind, f.signal, f.count) for f in plain
    ]


@pytest.mark.parametrize("hold", [3, 8, 12])
def test_outliers_between_the_steps_of_a_held_input_are_named(hold):
    """Twenty spikes of 5 in readings within ±1 and noise of 0.002: each lone one is told."""
    rng = np.random.default_rng(0)
    n = 8000
    u = np.repeat(np.sign(rng.normal(size=n // hold + 1)), hold)[:n]
    y = lfilter([0.0, 0.1], [1, -0.9], u) + 0.002 * rng.normal(size=n)
    spikes = np.sort(rng.choice(np.arange(10, n - 10), 20, replace=False))
    y[spikes] += 5
    apart = np.diff(spikes, prepend=-n, append=2 * n)
    lone = int(np.sum(np.minimum(apart[:-1], apart[1:]) > 12))
    finding = named(Recording.from_arrays(u, y, T))["displacement", FindingKind.OUTLIERS]
    assert lone >= 12 and lone <= finding.count <= 20 and finding.size == pytest.approx(5, rel=0.1)
    clean = Recording.from_arrays(u, lfilter([0.0, 0.1], [1, -0.9], u) + 0.002 * rng.normal(size=n), T)
    assert ("displacement", FindingKind.OUTLIERS) not in named(clean)


@pytest.mark.parametrize("lag", [0.2, 0.8])
@pytest.mark.parametrize("command", ["noise", "holds"])
def test_spikes_are_named_also_where_the_command_moves(command, lag):
    """Spikes of 30 deviations of the noise lie anywhere: beside jumps of the command, and in fast motion."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        slow = lfilter([0.05], [1.0, -0.95], rng.normal(size=3000))
        inputs = slow if command == "noise" else np.repeat(rng.uniform(size=100), 30)
        outputs = lfilter([0.0, 1.0 - lag], [1.0, -lag], inputs)
        noise = 0.01 * np.ptp(outputs)
        spikes = np.sort(rng.choice(np.arange(50, 2950), 3, replace=False))
        outputs += noise * rng.normal(size=3000)
        outputs[spikes] += 30.0 * noise * rng.choice([-1.0, 1.0], 3)
        (found,) = [
            one
            for one in inspect_recordings(Recording.from_arrays(inputs, outputs, 1.0))
            if one.kind is FindingKind.OUTLIERS
        ]
        assert f"3 outlying readings, at {', '.join(map(str, spikes))} s" in found.text


@pytest.mark.parametrize("size", [2, 10, 100])
def test_a_trend_is_named_however_large(size):
    def change(y):
        return y + size * y.std() * np.linspace(0, 1, y.size)

    assert named(record(change))["displacement", FindingKind.TREND].size == pytest.approx(
        size * record().outputs.std(), rel=0.25
    )
