"""What a frequency response says of itself: gain, phase and their spread, drawings, xarray."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from matplotlib import pyplot

from deatwin.ident.frequency import (
    Equilibrium,
    FrequencyResponse,
    FrequencyStatus,
    frequency_grid,
    gfrf,
    output_spectrum,
)
from deatwin.ident.frequency.drawing import bode
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

TERMS = {"y(k-1)": 1.2, "y(k-2)": -0.6, "u(k-1)": 0.4, "y(k-1)^2": 0.02, "y(k-1)u(k-2)": 0.03, "u(k-1)^3": 0.1}
ROOT = 2e-3 * np.random.default_rng(0).normal(size=(6, 6))
MODEL = NarxModel.from_terms(TERMS, sample_time=0.02, theta_cov=ROOT @ ROOT.T, input_units=("V",), output_units=("µm",))
OMEGA = 2 * np.pi * np.geomspace(0.1, 24.0, 60)
AXIS = 2 * np.pi * np.linspace(-20.0, 20.0, 9)


def response(values, gradient, theta_cov, omega=None, symbol="H"):
    """One that does not come from a model."""
    point = Equilibrium(operating_input=np.zeros(1), outputs=np.zeros(1), stable=np.ones(1, dtype=bool), chosen=0)
    values = np.asarray(values, dtype=complex)
    return FrequencyResponse(
        symbol=symbol,
        order=1,
        values=values,
        omega=np.arange(1.0, values.size + 1) if omega is None else omega,
        point=point,
        status=FrequencyStatus.at(point),
        unit="m",
        theta_cov=np.asarray(theta_cov, dtype=float),
        differentiate=lambda: np.asarray(gradient, dtype=complex),
    )


def test_spread_of_gain_and_phase_is_the_ellipse_along_and_across_the_value():
    """The value 2j with deviations 0.1 of the real and 0.3 of the imaginary part."""
    found = response([2j], [[0.1, 0.3j]], np.eye(2))
    np.testing.assert_allclose(found.covariance[0], np.diag([0.01, 0.09]), atol=1e-17)
    np.testing.assert_allclose(found.gain_deviation, 0.3, rtol=1e-14)
    np.testing.assert_allclose(found.phase_deviation_deg, np.degrees(0.05), rtol=1e-14)


def test_near_zero_gain_the_linear_law_is_not_claimed():
    """The longer axis counts: 3 is 30 deviations of 0.1 in its own direction and 3 of 1 across it."""
    found = response([3.0, 5.0, 0.0], [[0.1, 1j]] * 3, np.eye(2))
    band = found.band()
    np.testing.assert_array_equal(band.linear_law, [False, True, False])
    assert band.low[2] == 0.0 and np.isinf(found.phase_deviation_deg[2])
    certain = response([0.0, 1.0], np.zeros((2, 1)), np.eye(1))
    np.testing.assert_array_equal(certain.phase_deviation_deg, 0.0)


def test_the_ellipse_of_correlated_parts():
    """The longer axis is the root of the larger eigenvalue, 1.9 for variances 1 and a correlation of 0.9."""
    root = np.linalg.cholesky([[1.0, 0.9], [0.9, 1.0]])
    at = np.sqrt(1.9) * 4
    found = response([0.999 * at, 1.001 * at], np.tile(root[0] + 1j * root[1], (2, 1)), np.eye(2))
    np.testing.assert_array_equal(found.band().linear_law, [False, True])


def test_phase_is_unwrapped_along_one_frequency_and_jumps_gaps():
    phase, none = -np.linspace(0, 12, 50), np.zeros((50, 1))
    np.testing.assert_allclose(response(np.exp(1j * phase), none, [[0.0]]).phase_deg, np.degrees(phase))
    phase[3] = np.nan
    np.testing.assert_allclose(response(np.exp(1j * phase), none, [[0.0]]).phase_deg, np.degrees(phase))


def test_results_are_frozen_and_differentiate_once():
    found = gfrf(MODEL, 2, frequency_grid(AXIS, AXIS))
    with pytest.raises(FrozenInstanceError):
        found.order = 3
    for array in (found.values, found.omega, found.gradient, found.covariance):
        assert not array.flags.writeable
    assert found.gradient is found.gradient
    np.testing.assert_allclose(found.frequency_Hz * 2 * np.pi, found.omega, rtol=1e-15)
    assert (found.label, found.unit) == ("$H_2$", "µm/V^2")


def labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def test_one_frequency_is_drawn_as_gain_with_its_band():
    axes = gfrf(MODEL, 1, OMEGA).plot()
    assert labels(axes) == ("frequency (Hz)", "gain (µm/V)") and axes.get_xscale() == axes.get_yscale() == "log"
    written = [text.get_text() for text in axes.get_legend().get_texts()]
    assert written == ["$|H_1|$", "95 % band"]
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), gfrf(MODEL, 1, OMEGA).gain)
    certain = gfrf(replace(MODEL, theta_cov=np.zeros((6, 6))), 1, OMEGA).plot()
    assert [text.get_text() for text in certain.get_legend().get_texts()] == ["$|H_1|$"]
    wide = gfrf(replace(MODEL, theta_cov=MODEL.theta_cov * 1e4), 1, OMEGA).plot()
    assert "linear law fails" in [text.get_text() for text in wide.get_legend().get_texts()]


def test_a_spectrum_is_drawn_at_its_lines():
    k = np.arange(50)
    axes = output_spectrum(MODEL, 0.1 * np.cos(2 * np.pi * 3 * k / 50), 3).plot()
    frequencies, gain = axes.lines[0].get_data()
    np.testing.assert_allclose(frequencies[np.isfinite(gain)], np.array([0, 3, 6, 9]) / (50 * 0.02))
    assert axes.get_xscale() == "linear" and axes.get_ylabel() == "gain (µm)"


def test_a_grid_of_two_frequencies_is_drawn_as_contours():
    found = gfrf(MODEL, 2, frequency_grid(AXIS, AXIS[2:]))
    shuffled = np.random.default_rng(0).permutation(len(found.omega))
    for given in (found, gfrf(MODEL, 2, found.omega[shuffled])):
        axes = given.plot()
        assert labels(axes) == ("$f_1$ (Hz)", "$f_2$ (Hz)")
        bar = axes.figure.axes[-1]
        assert bar.get_ylabel() == "|$H_2$| (dB re 1 µm/V$^2$)"
        np.testing.assert_allclose(axes.get_xlim(), (-20, 20))
        np.testing.assert_allclose(axes.get_ylim(), (-10, 20))
        levels = axes.collections[0].levels
        decibels = 20 * np.log10(found.gain)
        assert levels[0] <= decibels.min() and levels[-1] >= decibels.max()


def test_points_that_are_no_grid_are_points():
    omega = np.random.default_rng(0).uniform(-100, 100, (20, 2))
    axes = gfrf(MODEL, 2, omega).plot()
    offsets = axes.collections[0].get_offsets()
    np.testing.assert_allclose(offsets, omega / (2 * np.pi))
    np.testing.assert_allclose(axes.collections[0].get_array(), 20 * np.log10(gfrf(MODEL, 2, omega).gain), atol=1e-8)
    diagonal = gfrf(MODEL, 3, np.tile(OMEGA[:, None], (1, 3))).plot()
    assert diagonal.get_title() == "" and len(diagonal.collections[0].get_offsets()) == OMEGA.size


def test_more_than_two_frequencies_are_drawn_at_the_middle_ones():
    cube = gfrf(MODEL, 3, frequency_grid(AXIS, AXIS, AXIS))
    plane = gfrf(MODEL, 3, frequency_grid(AXIS, AXIS, [AXIS[4]]))
    axes, alone = cube.plot(), plane.plot()
    assert axes.get_title() == alone.get_title() == "$f_3$ = 0 Hz"
    np.testing.assert_array_equal(axes.collections[0].levels, alone.collections[0].levels)
    fourth = gfrf(MODEL, 4, frequency_grid(AXIS[:3], AXIS[:3], AXIS[:2], AXIS[:2]))
    assert fourth.plot().get_title() == "$f_3$ = -15 Hz, $f_4$ = -20 Hz"


def test_bode():
    found = gfrf(MODEL, 1, OMEGA)
    gain, phase = bode(found)
    assert labels(gain) == ("", "gain (µm/V)") and labels(phase) == ("frequency (Hz)", "phase (°)")
    np.testing.assert_array_equal(phase.lines[0].get_ydata(), found.phase_deg)
    with pytest.raises(ModelError, match="one frequency for each value"):
        bode(gfrf(MODEL, 2, frequency_grid(AXIS, AXIS)))
    with pytest.raises(ModelError, match="needs two axes"):
        bode(found, [pyplot.subplots()[1]])


def test_a_response_of_zero_says_so():
    linear = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=0.02)
    nothing = replace(gfrf(linear, 1, OMEGA), values=np.zeros(60, complex))
    for found in (gfrf(linear, 2, frequency_grid(AXIS, AXIS)), nothing):
        assert "zero everywhere" in [text.get_text() for text in found.plot().texts]
