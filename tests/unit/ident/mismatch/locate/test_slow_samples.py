"""Plants that are sampled slowly: a room each minute, each five minutes."""

import numpy as np
import pytest

from deatwin.ident.discrepancy import Track as Learned
from deatwin.ident.discrepancy import gaussian_process
from deatwin.ident.mismatch.locate.frequency import locate_frequency
from deatwin.ident.mismatch.locate.time import locate_time
from deatwin.ident.mismatch.locate.track import Track
from deatwin.ident.mismatch.quality.repeats import find_repeats
from deatwin.ident.mismatch.quality.suspects import stuck
from deatwin.ident.soundness import RISE_SAMPLES
from deatwin.plant.recording import Recording

SLOW = pytest.mark.parametrize("sample_time", [60.0, 300.0, 3600.0])


def track(residual: np.ndarray, sample_time: float) -> Track:
    return Track(timepts=sample_time * np.arange(residual.size), residual=residual, signals={}, sample_time=sample_time)


@SLOW
def test_a_tone_is_found_at_its_frequency_and_noise_is_none(sample_time):
    hits = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=1440)
        tone = 0.05 / sample_time  # one in twenty samples
        wave = np.sin(2 * np.pi * tone * sample_time * np.arange(1440))
        hits += bool(len(locate_frequency([track(noise, sample_time)], 1.0)))
        (band,) = locate_frequency([track(noise + wave, sample_time)], 1.0)
        assert band.from_Hz < tone < band.to_Hz < 2 * tone
    assert hits <= 3  # of 20 where one in twenty is expected: more comes once in 60 times


@SLOW
def test_an_onset_is_found_within_three_windows(sample_time):
    rng = np.random.default_rng(5)
    found = locate_time([track(rng.normal(size=1000) * np.where(np.arange(1000) < 500, 1.0, 4.0), sample_time)], 1.0)
    late = max(found.windows, key=lambda window: window.score)
    assert late.score > 0.9
    assert abs(late.from_s / sample_time - 500) <= 3 * RISE_SAMPLES
    assert not find_repeats([np.random.default_rng(0).normal(size=500)], sample_time)


@SLOW
def test_a_thermometer_in_coarse_steps_under_a_thermostat_is_not_stuck(sample_time):
    # First order with a time constant of forty samples; steps of a hundredth of the range.
    heat = np.repeat(np.random.default_rng(2).choice([0.0, 1.0], 150), 7)
    rise, state = [], 0.0
    for u in heat:
        state += (u - state) / 40
        rise.append(round(state * 100) / 100)
    record = Recording.from_arrays(heat, np.array(rise), sample_time)
    assert not stuck(record).any()


@SLOW
def test_a_gaussian_process_learns_a_lagged_residual(sample_time):
    drive = np.random.default_rng(1).normal(size=600)
    residual = 0.5 * np.roll(drive, 1)
    learned = gaussian_process(
        Learned(residual=residual, reading=drive, rate=drive, drive=drive, cut=400, sample_time=sample_time, size=1.0)
    )
    left = residual[400:] - learned.predicted
    assert left.std() < 0.5 * residual.std()  # a lag of one sample, of five regressors


def test_a_reading_that_is_missing_for_most_of_a_record_has_its_mismatch_where_it_is_known():
    """Missing values count as 0, and most windows are then alike."""
    residual = np.where(np.arange(1500) < 500, 2.0 + np.random.default_rng(6).normal(size=1500), 0.0)
    (window,) = locate_time([track(residual, 0.02)], 1.0).windows
    assert (window.from_s, window.to_s) == pytest.approx((0.0, 10.0), abs=0.1)
