"""Location in time, frequency and operating region, each on a recording with a known concealed defect."""

from dataclasses import replace

import numpy as np
import pytest
from needs import COMPILED
from runs import blank

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.mismatch.locate.frequency import locate_frequency
from deatwin.ident.mismatch.locate.region import locate_region
from deatwin.ident.mismatch.locate.time import locate_time
from deatwin.ident.mismatch.locate.track import Track, tracks
from deatwin.plant import Diaphragm, Experiment, Plant
from deatwin.plant.excitation import band_limited_noise

pytestmark = COMPILED
NOISE, MODEL_ERROR = 2e-6, 1.2e-6
FLOOR = NOISE**2 + MODEL_ERROR**2


@pytest.fixture(scope="module")
def clean():
    """Two minutes of noise by the diaphragm with parameters that differ from the nominal ones."""
    command = band_limited_noise(np.random.default_rng(0), 120.0, 0.02)
    truth = Plant(rig=Diaphragm()).with_values({"shear_modulus": 28e3, "permittivity": 4.2})
    return truth.record(blank(command), np.random.default_rng(1))


def located(clean: Experiment, spoil) -> tuple[Track, ...]:
    """Tracks of the base plant, calibrated on a recording in which something is concealed."""
    record = clean.recordings[0]
    outputs = spoil(record.timepts, record.outputs[0])[None]
    experiment = Experiment(recordings=(replace(record, outputs=outputs),))
    found = calibrate(Plant(rig=Diaphragm()), [Part.whole(experiment)], starts=1)
    return tracks(found.plant, (experiment,))


def test_a_jump_is_located_in_time(clean):
    onset = 70.0
    windows = locate_time(located(clean, lambda t, y: y + 12e-6 * (t >= onset)), FLOOR)
    edges = [w.from_s for w in windows] + [w.to_s for w in windows]
    # windows of two seconds can place an onset no better than to one window
    assert min(abs(edge - onset) for edge in edges) <= 2.0
    assert sum(w.score for w in windows) == pytest.approx(1.0)


def test_a_burst_is_located_in_time(clean):
    burst = lambda t, y: y + 15e-6 * np.sin(2 * np.pi * 3 * t) * ((t >= 40) & (t < 50))  # noqa: E731
    windows = locate_time(located(clean, burst), FLOOR)
    worst = max(windows, key=lambda w: w.score)
    assert worst.score > 0.9
    assert abs(worst.from_s - 40.0) <= 2.0
    assert abs(worst.to_s - 50.0) <= 2.0


def test_a_tone_is_located_in_frequency(clean):
    bands = locate_frequency(located(clean, lambda t, y: y + 5e-6 * np.sin(2 * np.pi * 3.3 * t)), NOISE)
    strongest = max(bands, key=lambda b: b.excess_dB)
    assert strongest.from_Hz <= 3.3 <= strongest.to_Hz
    # lines lie 0.05 Hz apart, and a Hann window is four lines wide
    assert strongest.to_Hz - strongest.from_Hz <= 0.5


def test_white_noise_has_few_bands():
    rng = np.random.default_rng(4)
    count = 0
    for _ in range(40):
        track = Track(
            timepts=0.02 * np.arange(6000), residual=NOISE * rng.standard_normal(6000), signals={}, sample_time=0.02
        )
        count += bool(locate_frequency([track], NOISE))
    # Benjamini-Hochberg holds the rate of any discovery on pure noise at 5 %: two of 40 expected, six is 1 in 100
    assert count <= 6


def test_a_clipped_reading_is_located_in_the_operating_region(clean):
    limit = float(np.quantile(clean.recordings[0].outputs[0], 0.85))
    regions = locate_region(located(clean, lambda t, y: np.minimum(y, limit)), 1e-6)
    top = [r for r in regions if r.signal == "displacement" and r.mean_residual < 0]
    assert top
    worst = min(top, key=lambda r: r.mean_residual)
    # the refit bends the plant towards the clipped reading, so the bin next to the limit may carry the worst mean
    assert worst.high >= 0.9 * limit / 1e-6


def test_a_perfect_plant_has_no_region():
    rng = np.random.default_rng(5)
    count = 0
    for _ in range(40):
        signal = np.cumsum(rng.standard_normal(6000))
        track = Track(
            timepts=0.02 * np.arange(6000),
            residual=NOISE * rng.standard_normal(6000),
            signals={"u": signal},
            sample_time=0.02,
        )
        count += bool(locate_region([track], 1e-6))
    assert count <= 8  # 5 % of 40 expected; normal tests of few seconds in a bin are allowed a few more


def test_a_constant_residual_lies_in_no_region_and_a_step_of_it_in_its_range():
    """A mean that is the same for all values of a signal does not depend on it; beyond its median it does."""
    rng = np.random.default_rng(6)
    signal = rng.standard_normal(6000)
    for residual, count in ((np.full(6000, 1e-6), 0), (np.where(signal > 0.0, 1e-6, 0.0), 1)):
        track = Track(
            timepts=0.02 * np.arange(6000),
            residual=residual + 1e-7 * rng.standard_normal(6000),
            signals={"u": signal},
            sample_time=0.02,
        )
        found = [one for one in locate_region([track], 1e-6) if one.mean_residual > 0.5]
        assert len(found) == count
    assert found[0].high == signal.max()
