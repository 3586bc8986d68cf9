"""What holds for every excitation and every measuring chain."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from deatwin.plant.chain import MeasuringChain
from deatwin.plant.datasheets import LK_G152, NI_9264, quantise
from deatwin.plant.excitation import (
    band_limited_noise,
    random_odd_harmonics,
    random_phase_multisine,
    share_above_band,
    with_alternating_polarity,
)

volts = st.floats(-10.0, 10.0, allow_subnormal=False)
signals = arrays(np.float64, st.integers(1, 60), elements=volts)
samples = st.integers(1, 20)
seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None, max_examples=100)
@given(signal=signals, segment=samples)
def test_reversing_twice_is_nothing(signal: np.ndarray, segment: int) -> None:
    reversed_once = with_alternating_polarity(signal, 0.02, 0.02 * segment)
    np.testing.assert_array_equal(np.abs(reversed_once), np.abs(signal))
    np.testing.assert_array_equal(with_alternating_polarity(reversed_once, 0.02, 0.02 * segment), signal)


@settings(deadline=None, max_examples=50)
@given(seed=seeds, seconds=st.integers(5, 60), band=st.floats(1.0, 25.0), limit=st.floats(0.1, 3.0))
def test_noise_keeps_its_limits_and_has_its_power_in_the_band_before_them(
    seed: int, seconds: int, band: float, limit: float
) -> None:
    def noise(limit: float) -> np.ndarray:
        rng = np.random.default_rng(seed)
        return band_limited_noise(rng, seconds, 0.02, 2.4, 0.36, band, 2.4 - limit, 2.4 + limit)

    assert np.abs(noise(limit) - 2.4).max() <= limit + 1e-15
    assert share_above_band(noise(np.inf), 0.02, band) < 1e-25
    np.testing.assert_array_equal(noise(limit), np.clip(noise(np.inf), 2.4 - limit, 2.4 + limit))


@settings(deadline=None, max_examples=50)
@given(
    seed=seeds,
    seconds=st.integers(5, 50),
    band=st.floats(2.0, 24.0),
    group=st.integers(2, 5),
    rms=st.floats(0.01, 2.0),
    periods=st.integers(1, 3),
)
def test_a_multisine_has_power_on_its_lines_only(
    seed: int, seconds: int, band: float, group: int, rms: float, periods: int
) -> None:
    rng = np.random.default_rng(seed)
    lines, detection = random_odd_harmonics(rng, seconds, band, group)
    command = random_phase_multisine(rng, seconds, 0.02, lines, rms, periods=periods, lower=-np.inf, upper=np.inf)
    n = 50 * seconds
    np.testing.assert_array_equal(command, np.tile(command[:n], periods))
    spectrum = np.abs(np.fft.rfft(command - 2.4)) / command.size
    np.testing.assert_allclose(spectrum[lines * periods], rms / np.sqrt(2.0 * lines.size), rtol=1e-9)
    assert spectrum[detection * periods].max() < 1e-13
    spectrum[lines * periods] = 0.0
    assert spectrum.max() < 1e-13


@settings(deadline=None, max_examples=100)
@given(values=signals, step=st.floats(1e-6, 10.0))
def test_rounding_is_near_and_done_once(values: np.ndarray, step: float) -> None:
    rounded = quantise(values, step)
    assert np.abs(rounded - values).max() <= 0.5 * step * (1.0 + 1e-9) + 1e-14
    np.testing.assert_array_equal(quantise(rounded, step), rounded)
    np.testing.assert_array_equal(quantise(-values, step), -rounded)


@settings(deadline=None, max_examples=50)
@given(wished=signals, bits=st.integers(8, 20))
def test_applied_commands_are_within_half_a_code(wished: np.ndarray, bits: int) -> None:
    chain = MeasuringChain(analogue_output=replace(NI_9264, bits=bits))
    step = chain.analogue_output.step
    assert np.abs(chain.applied(wished) - wished).max() <= 0.5 * step * (1.0 + 1e-9)


@settings(deadline=None, max_examples=50)
@given(seed=seeds, readings=arrays(np.float64, st.integers(1, 60), elements=st.floats(-39e-3, 39e-3)))
def test_without_noise_a_record_is_within_half_of_each_step(seed: int, readings: np.ndarray) -> None:
    chain = MeasuringChain(laser=replace(LK_G152, noise=0.0, scan_time=0.0))
    error = chain.record(readings, np.random.default_rng(seed), sample_time=0.02) - readings
    assert np.abs(error).max() <= 0.5 * (chain.reading_step + LK_G152.resolution) * (1.0 + 1e-9)
