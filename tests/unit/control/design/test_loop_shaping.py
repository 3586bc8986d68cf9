"""Loop shaping: bounds are kept, and the integral gain is the largest."""

import numpy as np
import pytest
from made_models import linear_model
from scipy.optimize import brentq

from deatwin.control import ControlError
from deatwin.control.design.loop_shaping import loop_shaping, loop_shaping_pid
from deatwin.control.design.pid import PidGains

H = 0.02
LIMITS = (1.0, 4.0)
OMEGA = np.concatenate([np.geomspace(1e-4, 0.1, 2000), np.linspace(0.1, np.pi, 20000)]) / H
BOTH = pytest.mark.parametrize("design", [loop_shaping, loop_shaping_pid])


def loop_of(linear, law, omega=OMEGA):
    top, bottom = law.feedback
    delay = np.exp(-1j * omega * H)
    return linear.response(omega) * np.polyval(top[::-1], delay) / np.polyval(bottom[::-1], delay)


def sensitivity_peak(linear, law):
    return float(np.abs(1.0 / (1.0 + loop_of(linear, law))).max())


def is_stable(linear, law):
    (top, bottom), (b, a) = law.feedback, (linear.numerator, linear.denominator)
    closed = np.polyadd(np.convolve(top, b)[::-1], np.convolve(bottom, a)[::-1])[::-1]
    return bool(np.all(np.abs(np.roots(closed)) < 1.0))


@pytest.fixture(params=["lag", "second", "resonant", "delayed"])
def linear(request, sampled):
    if request.param == "resonant":  # a ball's mode at 10 Hz beside a slow lag
        mode = np.exp(2 * np.pi * 10.0 * H * (-0.02 + 1j * np.sqrt(1 - 0.02**2)))
        den = np.poly([mode, mode.conj(), np.exp(-H / 0.3)]).real
        return linear_model([0.0, -2.0 * den.sum()], den, operating_input=2.0, operating_output=1.0)
    return {
        "lag": sampled(3.0, [0.5], delay=3),
        "second": sampled(-2.0, [0.6, 0.3], delay=2),
        "delayed": sampled(1.0, [0.005], delay=10),
    }[request.param]


@BOTH
def test_the_bounds_are_kept_and_one_is_reached(linear, design):
    found = design(linear, command_limits=LIMITS, phase_margin_deg=45.0, max_sensitivity=1.5)
    assert is_stable(linear, found.law)
    peak, values = sensitivity_peak(linear, found.law), loop_of(linear, found.law)
    crossings = [
        brentq(lambda omega: np.log(np.abs(loop_of(linear, found.law, omega))), OMEGA[i], OMEGA[i + 1], xtol=1e-9)
        for i in np.flatnonzero((np.abs(values[:-1]) >= 1.0) & (np.abs(values[1:]) < 1.0))
    ]
    margin = np.degrees(np.abs(np.angle(-loop_of(linear, found.law, np.array(crossings))))).min()
    assert peak < 1.5 * (1 + 2e-3)  # what lies between two points of the grid
    assert margin > 45.0 - 0.01
    assert peak > 1.5 * (1 - 5e-3) or margin < 45.1
    assert found.closed_loop_time == pytest.approx(1.0 / crossings[-1], rel=1e-4)


@BOTH
def test_the_phase_margin_is_kept_where_the_crossover_depends_on_the_time_constant(design):
    """The crossover of the best time constant then lies apart from those of the time constants tried first."""
    lags = linear_model([0.0, 0.012], [1.0, -1.73, 0.745])
    found = design(lags, command_limits=(-1.0, 1.0), phase_margin_deg=60.0, max_sensitivity=2.2)
    omega = brentq(lambda omega: np.log(np.abs(loop_of(lags, found.law, omega))), 1.0, 100.0, xtol=1e-9)
    assert np.degrees(np.angle(-loop_of(lags, found.law, omega))) == pytest.approx(60.0, abs=0.01)


def test_no_other_pi_within_the_bound_has_more_integral_gain(sampled):
    linear = sampled(3.0, [0.5], delay=3)
    best = loop_shaping(linear, command_limits=LIMITS, phase_margin_deg=0.0).law.b[0, 0] / H
    for proportional in np.linspace(0.0, 3.0, 61):
        law = PidGains(proportional=proportional, integral=1.01 * best).law(H)
        assert sensitivity_peak(linear, law) > 1.4 or not is_stable(linear, law)


@BOTH
@pytest.mark.parametrize("crossover", [0.1, 0.3])
def test_a_given_crossover_is_met(sampled, design, crossover):
    linear = sampled(-3.0, [0.5, 0.1], delay=2)
    found = design(linear, command_limits=LIMITS, crossover_Hz=crossover, phase_margin_deg=50.0)
    value = loop_of(linear, found.law, np.array([2 * np.pi * crossover]))[0]
    assert abs(value) == pytest.approx(1.0, rel=1e-9)
    assert np.degrees(np.abs(np.angle(-value))) > 50.0 - 1e-6
    assert sensitivity_peak(linear, found.law) < 1.4 * (1 + 2e-3)
    assert found.closed_loop_time == pytest.approx(1 / (2 * np.pi * crossover))


@BOTH
def test_a_crossover_beyond_reach_is_refused_with_what_can_be_reached(sampled, design):
    linear = sampled(3.0, [0.5], delay=5)
    with pytest.raises(ControlError, match=r"cannot be reached: the phase margin there is at most") as error:
        design(linear, command_limits=LIMITS, crossover_Hz=4.0)
    reachable = float(str(error.value).rsplit("of ", 1)[1].removesuffix(" Hz"))
    design(linear, command_limits=LIMITS, crossover_Hz=0.98 * reachable)
    if design is loop_shaping:
        with pytest.raises(ControlError):
            design(linear, command_limits=LIMITS, crossover_Hz=1.05 * reachable)


def test_a_pid_integrates_more_than_a_pi(sampled):
    linear = sampled(2.0, [0.6, 0.3], delay=2)
    pi, pid = (design(linear, command_limits=LIMITS).law.b[0, 0] for design in (loop_shaping, loop_shaping_pid))
    assert pid > 1.5 * pi
