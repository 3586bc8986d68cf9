"""Tones and cycles in a residual, and the tone in a reading."""

import numpy as np
import pytest
from runs import readings

from deatwin.plant import Coupon, Plant
from deatwin.plant.effects.lines import slow_cycles, spectral_peaks, tone_at, tones
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.resonance import Resonance
from deatwin.plant.effects.sizes import Sizes

SAMPLE = 0.02


pytestmark = pytest.mark.usefixtures("uncompiled")


def angle_between(first, second):
    return abs(np.angle(np.exp(1j * (first - second))))


def test_a_line_is_fitted_exactly_beside_a_constant():
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0, 20, 200))  # uneven: gaps do no harm
    tone = tone_at(times, 3.0 + 2.0 * np.cos(2 * np.pi * 0.7 * times - 1.1), 0.7)
    assert tone.amplitude == pytest.approx(2.0, rel=1e-12)
    assert tone.phase == pytest.approx(-1.1, rel=1e-12)
    assert tone.explained == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("gap", [0.0, 37.0])
def test_tones_are_found_under_a_drift_that_is_larger(gap):
    rng = np.random.default_rng(7)
    n = 6000
    times = SAMPLE * np.arange(n) + np.where(np.arange(n) > n // 2, gap, 0.0)
    drift = 50e-6 * (1 - np.exp(-times / 60)) + 10e-6 * np.cumsum(rng.standard_normal(n)) / np.sqrt(n)
    sines = 2e-6 * np.cos(2 * np.pi * 3.21 * times + 0.5) + 4e-6 * np.cos(2 * np.pi * 0.4 * times - 2.0)
    found = PeriodicDisturbance().starts(times, drift + sines + 2e-6 * rng.standard_normal(n))
    assert 2 <= len(found) <= 3
    span = np.ptp(times)
    for frequency, amplitude, phase in ((3.21, 2e-6, 0.5), (0.4, 4e-6, -2.0)):
        best = min(found, key=lambda e: abs(e.frequency - frequency))
        # A fit converges from within half the resolution.
        assert abs(best.frequency - frequency) < 0.2 / span
        assert best.amplitude == pytest.approx(amplitude, rel=0.3)
        at_middle = 2 * np.pi * (best.frequency - frequency) * times.mean() + best.phase
        assert angle_between(at_middle, phase) < 0.3


def test_a_mains_alias_is_found_at_its_slow_frequency():
    times = SAMPLE * np.arange(10000)
    residual = 3e-6 * np.cos(2 * np.pi * 50.03 * times)
    best = PeriodicDisturbance().starts(times, residual + 1e-9 * np.sin(times**2))[0]
    assert best.frequency == pytest.approx(0.03, abs=0.2 / 200)


def test_short_records_have_no_starts():
    times = SAMPLE * np.arange(10)
    assert tones(times, np.sin(times)) == ()
    assert spectral_peaks(times, np.sin(times), (1.0, 20.0)) == ()
    assert slow_cycles(times, np.sin(times), (20.0, 100.0)) == ()


def test_peaks_lie_in_the_band():
    rng = np.random.default_rng(1)
    times = SAMPLE * np.arange(4000)
    values = rng.standard_normal(4000) + np.cos(2 * np.pi * 7.0 * times) + np.cos(2 * np.pi * 0.5 * times)
    found = spectral_peaks(times, values, (1.0, 24.0))
    assert found[0] == pytest.approx(7.0, abs=0.2)
    assert all(1.0 <= f <= 24.0 for f in found)


def test_a_second_mode_is_looked_for_up_to_half_the_sampling_rate():
    """A payload at 140 Hz on a stage that is sampled at 2 kHz; at 50 samples a second, nothing above 25 Hz is seen."""
    rng = np.random.default_rng(1)
    times = 5e-4 * np.arange(8000)
    values = rng.standard_normal(8000) + np.cos(2 * np.pi * 140.0 * times)
    for mode in (Resonance(), Sizes(period=0.04).of(Resonance())):
        found = [(e.frequency, e.described("frequency")) for e in mode.starts(times, values)]
        assert found[0][0] == pytest.approx(140.0, abs=4.0)
        assert all(known.lower <= value <= min(known.upper, 1000.0) for value, known in found)
        assert all(e.frequency < 25.0 for e in mode.starts(SAMPLE * np.arange(8000), values))


@pytest.mark.parametrize("frequency", [0.37, 50.03])
def test_a_tone_is_added_to_the_reading(frequency):
    # On a strip that is not pulled the reading is the tone, at the end of each sample; 50.03 Hz at its alias.
    effect = PeriodicDisturbance(amplitude=4e-6, frequency=frequency, phase=0.3)
    reading = readings(Plant(rig=Coupon(), effects=(effect,)), np.ones(400), start=12.0)
    times = 12.0 + SAMPLE * np.arange(1, 401)
    alias = frequency - 50.0 * np.round(frequency / 50.0)
    np.testing.assert_allclose(reading, 4e-6 * np.cos(2 * np.pi * alias * times + 0.3), atol=1e-15)


def test_a_tone_faster_than_the_effect_may_be_is_no_start():
    """A rig with motions of microseconds, seen at the diaphragm's pace, has lines beyond the effect's range."""
    times = 1e-4 * np.arange(6000)
    residual = 1e-6 * np.sin(2 * np.pi * 1300.0 * times)
    assert all(1e-4 <= s.frequency <= 1000.0 for s in PeriodicDisturbance().starts(times, residual))
    assert PeriodicDisturbance().starts(10.0 * times, residual)  # ten times slower it is one
