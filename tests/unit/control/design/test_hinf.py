"""H-infinity: bounds on a grid of their own, integral action, and what is said where it cannot be done."""

import control
import numpy as np
import pytest

from deatwin.control import ControlError
from deatwin.control.design import hinf as module
from deatwin.control.design.hinf import MixedSensitivity, hinf
from deatwin.control.design.states import States

pytestmark = pytest.mark.extras

H = 0.02
LIMITS = (1.0, 4.0)
OMEGA = np.concatenate([np.geomspace(1e-7, 0.1, 3000), np.linspace(0.1, np.pi, 5000)[:-1]]) / H


@pytest.fixture
def slycot():
    return pytest.importorskip("slycot")


def weights(bounds, omega):
    return [np.abs(system(1j * np.tan(0.5 * omega * H))) for system in bounds.weights()]


def weighted(linear, law, bounds):
    """Values of the weighted S and C S over the grid."""
    top, bottom = law.feedback
    delay = np.exp(-1j * OMEGA * H)
    through = np.polyval(top[::-1], delay) / np.polyval(bottom[::-1], delay)
    sensitivity = 1.0 / (1.0 + linear.response(OMEGA) * through)
    first, second = weights(bounds, OMEGA)
    return first * np.abs(sensitivity), second * np.abs(through * sensitivity * linear.static_gain)


CASES = [
    ({"gain": -2.0, "lags": [0.01]}, {"bandwidth_Hz": 1.0}),
    ({"gain": 3.0e-4, "lags": [0.5], "delay": 2}, {"bandwidth_Hz": 0.25, "effort": 4.0}),
    ({"gain": 1.0, "lags": [10.0, 0.05], "leads": [8.0], "delay": 1}, {"bandwidth_Hz": 0.4, "max_sensitivity": 1.7}),
    ({"gain": 2.0, "lags": [0.6, 0.2]}, {"bandwidth_Hz": 0.1, "max_sensitivity": 1.4, "effort": 3.0}),
]


@pytest.mark.parametrize(("model", "settings"), CASES)
def test_the_bounds_hold_on_a_dense_grid(slycot, sampled, around, model, settings):
    linear = sampled(**model)
    found = hinf(linear, command_limits=LIMITS, **settings)
    bounds = MixedSensitivity(**({"max_sensitivity": 1.5, "effort": 2.0, "sample_time": H} | settings))
    error, command = weighted(linear, found.law, bounds)
    # The integrator was moved by 1e-4 of the bandwidth, and the model balanced to 1e-8.
    assert np.hypot(error, command).max() < 1.0 + 1e-3
    assert np.abs(np.linalg.eigvals(around(linear, found).A)).max() < 1.0
    assert np.abs(found.law.poles - 1.0).min() < 1e-12


@pytest.mark.parametrize(("model", "settings"), CASES)
def test_the_bilinear_transform_keeps_the_norm(slycot, sampled, model, settings):
    # In the w plane, before the pole is moved: the norm of the closed loop by python-control, against that on the grid.
    linear = sampled(**model)
    bounds = MixedSensitivity(**({"max_sensitivity": 1.5, "effort": 2.0, "sample_time": H} | settings))
    plant = module._to_w(States.of(linear).balanced())
    found = module._synthesis(plant, bounds)
    norm = control.system_norm(module._weighted(plant, bounds).lft(found), "inf", tol=1e-9)
    law = module._from_w(found).scaled(1.0 / linear.static_gain)
    error, command = weighted(linear, law, bounds)
    assert np.hypot(error, command).max() == pytest.approx(norm, rel=1e-3)
    assert norm <= 1.0 + 1e-6


def test_more_bandwidth_than_the_delay_allows_is_refused_with_what_can_be_reached(slycot, sampled):
    linear = sampled(1.0, [0.01], delay=9)  # 0.2 s
    with pytest.raises(ControlError, match="cannot be met; with these bounds") as error:
        hinf(linear, command_limits=LIMITS, bandwidth_Hz=5.0)
    reachable = float(str(error.value).split("bounds ")[-1].split(" Hz")[0])
    assert reachable < 1.0 / (2 * np.pi * 0.2)  # theory: the bandwidth times the delay stays below one
    hinf(linear, command_limits=LIMITS, bandwidth_Hz=0.98 * reachable)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bandwidth_Hz": 0.0}, "half the sampling rate"),
        ({"bandwidth_Hz": 25.0}, "half the sampling rate"),
        ({"max_sensitivity": 1.0}, "max_sensitivity is 1: it must be above 1"),
        ({"effort": 0.5}, "effort is 0.5: it must be above 1"),
    ],
)
def test_senseless_bounds_are_refused(settings, message):
    values = {"bandwidth_Hz": 0.5, "max_sensitivity": 1.5, "effort": 2.0, "sample_time": H}
    with pytest.raises(ControlError, match=message):
        MixedSensitivity(**(values | settings))


def test_the_weights_are_the_inverse_bounds():
    bounds = MixedSensitivity(bandwidth_Hz=0.5, max_sensitivity=1.5, effort=2.0, sample_time=H)
    omega = np.linspace(0.1, 150.0, 20)
    w, b = 1j * np.tan(0.5 * omega * H), np.tan(np.pi * 0.5 * H)
    first = (w / 1.5 + b) / (w + 1e-4 * b)
    second = (1 + w / (2 * b)) / (1 + w / (200 * b)) / 2.0
    for found, expected in zip(weights(bounds, omega), (first, second), strict=True):
        np.testing.assert_allclose(found, np.abs(expected), rtol=1e-12)
