"""Short-time spectra of periodic recordings, which are predicted exactly."""

from dataclasses import replace

import numpy as np
import pytest
from made_narx import trajectory_of

from deatwin.ident.frequency.varying.short_time import BANDS, compare_windows, series_error, short_time, windows_of
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.wander import CONSTANT, VARYING
from deatwin.plant.recording import Recording

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
