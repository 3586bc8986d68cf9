"""Reduction and lambda tuning: PI, and PID by the half rule."""

import control
import numpy as np
import pytest
from made_models import linear_model

from deatwin.control import ControlError, lambda_tuning
from deatwin.control.design.lambda_tuning import (
    default_closed_loop_time,
    lambda_tuning_pid,
    reduce_to_first_order,
    reduce_to_second_order,
)

H = 0.02
LIMITS = (1.0, 4.0)


def pi_gains(controller):
    """Proportional gain, and integral gain by second."""
    step = controller.law.b[0, 0]
    return controller.law.d[0] - step, step / H


def answer(closed, samples):
    """Output after a unit step of the reference."""
    timepts = H * np.arange(samples)
    return np.asarray(control.forced_response(closed, timepts, np.ones(samples)).outputs[0])


@pytest.mark.parametrize(("lag", "delay"), [(0.2, 0), (0.5, 5), (2.0, 20)])
def test_a_lag_with_a_delay_is_found_again(sampled, lag, delay):
    found = reduce_to_first_order(sampled(-3.0, [lag], delay=delay))
    assert found.gain == pytest.approx(-3.0)
    assert found.time_constant == pytest.approx(lag, rel=0.01)
    assert found.delay == pytest.approx(delay * H, abs=0.002)


def test_slow_creep_of_a_fast_actuator_is_no_lag():
    # 85 % at once, the rest with 10 s
    slow = np.exp(-H / 10.0)
    linear = linear_model([0.0, 0.85 + 0.15 * (1 - slow), -0.85 * slow], [1.0, -slow], operating_input=2.0)
    assert linear.static_gain == pytest.approx(1.0)
    assert reduce_to_first_order(linear).time_constant < H
    found = lambda_tuning(linear, command_limits=LIMITS)
    assert found.name == "I"
    assert pi_gains(found)[0] == pytest.approx(0.0, abs=1e-15)


def test_gains_follow_the_rule(sampled):
    linear = sampled(3.0, [0.5], delay=4)
    tuned, reduced = lambda_tuning(linear, command_limits=LIMITS, closed_loop_time=0.3), reduce_to_first_order(linear)
    assert tuned.name == "PI"
    proportional, integral = pi_gains(tuned)
    assert integral == pytest.approx(1 / (3.0 * (0.3 + reduced.delay + H / 2)))
    assert proportional == pytest.approx(reduced.time_constant * integral)


@pytest.mark.parametrize("gain", [2.0, -2.0])
@pytest.mark.parametrize(("tuning", "lags", "delay"), [(lambda_tuning, [0.5], 3), (lambda_tuning_pid, [0.5, 0.2], 3)])
def test_the_closed_loop_is_as_fast_as_was_asked_for(sampled, around, tuning, lags, delay, gain):
    linear = sampled(gain, lags, delay=delay)
    tuned = tuning(linear, command_limits=LIMITS, closed_loop_time=0.4)
    output = answer(around(linear, tuned), 400)
    # First order with lambda = 0.4 s after the delay, within what expanding the delay leaves. The derivative is of the
    # reading alone, which takes one lag off the reference's way and not off the loop's.
    reached = H * np.argmax(output > 1 - np.exp(-1)) - delay * H
    assert reached == pytest.approx(0.4 + (0.2 if tuning is lambda_tuning_pid else 0.0), rel=0.2)
    assert output.max() < 1.05
    assert output[-1] == pytest.approx(1.0, abs=1e-3)


def test_the_default_crossover_lies_inside_the_excited_band(sampled):
    linear = sampled(1.0, [0.005])
    tuned = lambda_tuning(linear, command_limits=LIMITS, band_Hz=0.2)
    assert tuned.closed_loop_time == pytest.approx(1 / (2 * np.pi * 0.1))
    assert default_closed_loop_time(linear, band_Hz=0.2) == tuned.closed_loop_time


def test_the_half_rule_reduces_the_example_of_its_author(sampled):
    # Skogestad (2003), example E2: lags 2, 1, 0.4, 0.2 and three of 0.05 s, a lead of 0.08 s, a zero at 1/0.3 to the
    # right: 2 s and 1.2 s with a delay of 0.77 s. The hold adds half a sample; the sampled zero is exp(h/0.3) to h^2.
    linear = sampled(1.0, [2.0, 1.0, 0.4, 0.2, 0.05, 0.05, 0.05], [0.08, -0.3])
    found = reduce_to_second_order(linear)
    assert found.gain == pytest.approx(1.0, rel=1e-4)
    assert (found.first_lag, found.second_lag) == pytest.approx((2.0, 1.2), rel=1e-4)
    assert found.delay == pytest.approx(0.77 + H / 2, abs=1e-3)


def test_the_half_rule_leaves_two_lags_and_a_delay_as_they_are(sampled):
    found = reduce_to_second_order(sampled(-3.0, [0.5, 0.2], delay=3))
    assert (found.gain, found.first_lag, found.second_lag) == pytest.approx((-3.0, 0.5, 0.2), rel=1e-6)
    assert found.delay == pytest.approx(3.5 * H, rel=1e-3)


def test_creep_beside_a_lead_is_a_gain(sampled):
    # 85 % within two lags, the rest with 10 s: (8.5 s + 1)/(10 s + 1), to be cancelled as 0.85.
    found = reduce_to_second_order(sampled(2.0, [10.0, 0.5, 0.2], [8.5]))
    assert found.gain == pytest.approx(2.0 * 0.85, rel=1e-3)
    assert (found.first_lag, found.second_lag) == pytest.approx((0.5, 0.2), rel=1e-2)


def test_pid_gains_follow_the_rule(sampled):
    # T_1 = 8 s exceeds 4 (lambda + theta), which limits the integral time. theta: 2 samples, half of one for the hold,
    # and one for the filter of the derivative, which is 0.1 * 0.3 s = 0.03 s.
    linear = sampled(2.0, [8.0, 0.3], delay=2)
    tuned = lambda_tuning_pid(linear, command_limits=LIMITS, closed_loop_time=0.4)
    horizon = 0.4 + 2.5 * H + 0.03
    series, integral_time = 8.0 / (2.0 * horizon), 4.0 * horizon
    proportional, integral = pi_gains(tuned)
    assert tuned.name == "PID"
    assert integral == pytest.approx(series / integral_time, rel=2e-3)
    assert proportional == pytest.approx(series * (1.0 + 0.3 / integral_time), rel=2e-3)
    assert tuned.law.d[1] == pytest.approx(-(tuned.law.d[0] + series * 0.3 / (0.03 + H)), rel=2e-3)


def test_a_lag_beyond_the_longest_response_is_refused(sampled):
    # 6000 s are 300 000 samples; 200 000 are computed.
    with pytest.raises(ControlError, match="has not settled to 63 % within 2000"):
        lambda_tuning(sampled(1.0, [6000.0]), command_limits=LIMITS)


def test_a_model_without_a_second_lag_and_an_oscillating_one_get_no_pid(sampled):
    poles = np.poly([0.9 + 0.3j, 0.9 - 0.3j]).real
    oscillating = linear_model([0.0, poles.sum()], poles, operating_input=2.0)
    for linear in (sampled(1.0, [0.5]), sampled(1.0, [0.5, 0.01]), oscillating):
        with pytest.raises(ControlError, match=r"no second lag.*lambda_tuning"):
            lambda_tuning_pid(linear, command_limits=LIMITS)
