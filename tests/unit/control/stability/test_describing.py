"""Describing functions against closed forms, quadrature, simulation and python-control."""

import math

import casadi as ca
import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.control.errors import ControlError
from deatwin.control.stability.describing import (
    Backlash,
    BoucWen,
    DeadZone,
    Quantiser,
    RateLimiter,
    Relay,
    Saturation,
    describing_function,
    describing_function_of_run,
)
from deatwin.plant.effects.hysteresis import Hysteresis

AMPLITUDES = np.geomspace(0.3, 60.0, 41)


@pytest.mark.parametrize(
    ("form", "map"),
    [
        (Saturation(limit=1.3, slope=2.0), lambda x: 2.0 * np.clip(x, -1.3, 1.3)),
        (DeadZone(limit=0.7, slope=2.0), lambda x: 2.0 * (x - np.clip(x, -0.7, 0.7))),
        (Quantiser(step=0.7), lambda x: 0.7 * np.floor(x / 0.7 + 0.5)),
        (Relay(level=1.5), lambda x: 1.5 * np.sign(x)),
    ],
)
def test_closed_forms_against_quadrature(form, map):
    # The quadrature halves panels until kinks and jumps add less than 1e-10.
    np.testing.assert_allclose(form(AMPLITUDES), describing_function(map, AMPLITUDES), atol=1e-9)


def test_quadrature_of_powers_in_closed_form():
    # The first harmonic of sin³ is 3/4, and of sin⁵ 5/8; even powers have none.
    np.testing.assert_allclose(describing_function(lambda x: x**3, [0.5, 2.0]), [0.75 * 0.25, 0.75 * 4.0], rtol=1e-12)
    np.testing.assert_allclose(describing_function(lambda x: x**5 + x**2, 1.0), 0.625, rtol=1e-12)


def test_quadrature_finds_a_plateau_that_the_peak_just_reaches():
    # A relay with a dead zone: 4/(pi A) sqrt(1 - (d/A)²), here just beyond the dead zone.
    amplitude = 1.0 + np.array([1e-8, 1e-4, 1e-2])
    found = describing_function(lambda x: np.sign(x) * (np.abs(x) > 1.0), amplitude)
    np.testing.assert_allclose(found, 4 / (np.pi * amplitude) * np.sqrt(1 - amplitude**-2.0), atol=1e-9)


@pytest.mark.parametrize(
    ("ours", "theirs", "least"),
    [
        (Saturation(limit=1.3), control.saturation_nonlinearity(1.3), 0.1),
        (Relay(level=1.5, hysteresis=0.4), control.relay_hysteresis_nonlinearity(1.5, 0.4), 0.41),
        (Backlash(gap=0.8), control.friction_backlash_nonlinearity(0.8), 0.1),
    ],
)
def test_against_the_classes_of_python_control(ours, theirs, least):
    amplitude = np.geomspace(least, 50.0, 60)
    np.testing.assert_allclose(ours(amplitude), control.describing_function(theirs, amplitude), atol=1e-12)


def slew(rate):
    def run(inputs, dt):
        outputs = np.zeros_like(inputs)
        # A triangle keeps the mean that it starts with: begin at the lag that it settles to.
        amplitude, omega = np.abs(inputs).max(), np.diff(inputs)[0] / dt / np.abs(inputs).max()
        slope = rate / (amplitude * omega)
        if slope * np.hypot(1, np.pi / 2) < 1:
            outputs[0] = _triangle_at_zero(amplitude, slope)
        for k in range(1, inputs.size):
            outputs[k] = outputs[k - 1] + np.clip(inputs[k] - outputs[k - 1], -rate * dt, rate * dt)
        return outputs

    return run


def _triangle_at_zero(amplitude, slope):
    """A triangle of a slope whose corners, at +-slope pi/2, lie where the sine has that value on its way back."""
    corner = np.pi - np.arcsin(np.pi * slope / 2)  # of t, on the falling sine
    return amplitude * (np.pi * slope / 2 - slope * corner)


@pytest.mark.parametrize("amplitude", [0.5, 1.1, 1.3, 1.6, 1.85, 1.87, 2.5, 10.0])
def test_a_rate_limiter_follows_in_part_and_then_not_at_all(amplitude):
    # Sampled 8000 times a period, a corner of the triangle comes up to a sample late, 8e-4 rad, twice in a period of
    # output 4/pi slope at most; where the output joins the sine again nothing is late.
    run = describing_function_of_run(slew(0.8), amplitude, 0.8, samples=8000)
    assert RateLimiter(rate=0.8)(amplitude, 0.8) == pytest.approx(run, abs=2e-5)


def test_a_rate_limited_triangle_in_closed_form():
    found = RateLimiter(rate=1.0)(10.0, 1.0)
    assert abs(found) == pytest.approx(4 / (np.pi * 10), rel=1e-12)
    assert np.angle(found) == pytest.approx(-np.arccos(np.pi / 20), rel=1e-12)


class Law:
    """Takes what an effect says to the builder of a plant."""

    def __init__(self):
        self.memory, self.velocity = ca.SX.sym("memory"), ca.SX.sym("velocity")

    def state(self, name, scale, start):
        return self.memory

    def signal(self, name):
        return self.velocity

    def rate(self, state, expression, mass):
        self.right = expression / mass

    @property
    def build(self):
        return self


class Known(Hysteresis):
    def own(self, name, build):
        return getattr(self, name)


@pytest.mark.parametrize("amplitude", [10e-6, 30e-6, 200e-6])
def test_the_hysteresis_of_the_plant_by_its_own_law(amplitude):
    effect, law = Known(force=2e-3, distance=30e-6), Law()
    force = effect.rewrite(0.0, law)
    rate = ca.Function("rate", [law.memory, law.velocity], [law.right])
    held = ca.Function("held", [law.memory], [-force])
    omega = 2 * np.pi * 100.0  # so fast that 10 nm/s, over which the plant smooths its corners, is nothing

    def run(inputs, dt):
        times = dt * np.arange(inputs.size)

        def right(t, memory):
            return [float(rate(memory[0], amplitude * omega * np.cos(omega * t)))]

        found = solve_ivp(right, (0, times[-1]), [0.0], t_eval=times, rtol=1e-9, atol=1e-11, max_step=2e-4)
        return np.array([float(held(m)) for m in found.y[0]])

    run_at = describing_function_of_run(run, amplitude, omega, samples=400, periods=12)
    expected = BoucWen(force=2e-3, distance=30e-6)(amplitude)
    # 400 samples of a signal with corners cost 1e-5; 12 periods let the start fade to exp(-4 * 12 * A/x) at most.
    assert expected == pytest.approx(run_at, rel=3e-5)


def test_bouc_wen_far_from_its_distance_in_closed_form():
    # Small sines do not reach the corner: a spring F/x. Large ones are a relay's, which is dry friction.
    assert BoucWen(force=2.0, distance=1.0)(1e-6) == pytest.approx(2.0, rel=1e-5)
    assert BoucWen(force=2.0, distance=1.0)(1e5) == pytest.approx(4 * 2.0 / (np.pi * 1e5) * 1j, rel=1e-2)


def test_bouc_wen_loses_the_area_of_its_loop():
    # Work in a period is pi A² Im N; the loop of the memory 1 - (1 + m) exp(-(x + A)/d) has the area 4A - 4 d m.
    for amplitude in (0.3, 1.0, 7.0, 30.0):
        area = 4 * amplitude - 4 * np.tanh(amplitude)
        found = BoucWen(force=1.0, distance=1.0)(amplitude)
        assert np.pi * amplitude**2 * found.imag == pytest.approx(area, rel=1e-10)


def test_what_does_not_move_has_no_describing_function():
    assert Relay(level=1.0, hysteresis=0.5)(0.4) == 0.0
    assert Backlash(gap=1.0)(0.4) == 0.0
    assert DeadZone(limit=0.5)(0.4) == pytest.approx(0.0, abs=1e-15)
    assert Quantiser(step=1.0)(0.4) == 0.0


def test_a_quantiser_of_many_steps_is_the_sum_over_its_edges():
    # Edges at (k + 1/2) steps, each a relay; a sum of 1e6 terms of at most 1 rounds by 1e-15 of its size, the
    # difference to a gain of 1, about 2 zeta(3/2) / pi² / ratio^(3/2), is up to 5e-7.
    for ratio in (9999.9, 10000.1, 10000.5, 12345.49999, 12345.5, 99999.97, 1e6 + 0.25):
        edges = np.arange(np.floor(ratio + 0.5)) + 0.5
        expected = 4.0 / (np.pi * ratio) * math.fsum(np.sqrt(1.0 - (edges / ratio) ** 2))
        assert Quantiser(step=0.5)(0.5 * ratio).real == pytest.approx(expected, abs=1e-14)


def test_a_quantiser_of_very_many_steps_is_a_gain_of_one():
    amplitude = np.array([1e8, 1e12, 1e300])
    bound = 2.0 * 2.6124 / np.pi**2 * amplitude**-1.5
    assert (abs(Quantiser(step=1.0)(amplitude) - 1.0) <= bound + 1e-15).all()
    assert Quantiser(step=1e-300)(1e300) == pytest.approx(1.0, abs=1e-15)
    assert Quantiser(step=1e300)(1e-300) == 0.0


@pytest.mark.parametrize(
    ("amplitude", "omega"),
    [
        ("1", 1.0),
        (None, 1.0),
        (1j, 1.0),
        (True, 1.0),
        ([[1.0], [1.0, 2.0]], 1.0),
        (1.0, "1"),
        (np.inf, 1.0),
        (np.nan, 1.0),
        (1.0, np.inf),
        ([1.0, 2.0], [1.0, 2.0, 3.0]),
    ],
)
def test_what_is_no_amplitude_or_frequency_is_refused(amplitude, omega):
    with pytest.raises(ControlError, match=r"amplitude|omega"):
        Quantiser(step=1.0)(amplitude, omega)


@pytest.mark.parametrize(
    "call",
    [
        lambda: Saturation(limit=-1.0),
        lambda: Quantiser(step=np.nan),
        lambda: Relay(level=1.0, hysteresis=-0.1),
        lambda: Saturation(limit=1.0)(0.0),
        lambda: describing_function(lambda x: x, -1.0),
        lambda: describing_function(lambda x: x[:3], 1.0),
        lambda: describing_function_of_run(lambda x, dt: x * np.nan, 1.0, 1.0),
    ],
)
def test_what_makes_no_sense_is_refused(call):
    with pytest.raises(ControlError):
        call()
