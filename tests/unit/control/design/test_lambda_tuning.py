"""Reduction, lambda tuning, and the sampled controller with its limits."""

import control
import numpy as np
import pytest

from deatwin.control import ControlError, LinearModel, PiController, lambda_tuning
from deatwin.control.design.lambda_tuning import reduce_to_first_order

H = 0.02


def first_order(gain: float, lag: float, delay: int) -> LinearModel:
    pole = np.exp(-H / lag)
    top = np.concatenate([np.zeros(delay + 1), [gain * (1 - pole)]])
    return LinearModel(
        numerator=top, denominator=[1.0, -pole], covariance=np.zeros((top.size + 1, top.size + 1)),
        sample_time=H, operating_input=2.0, operating_output=1.0,
    )  # fmt: skip


def pi(**changes: float) -> PiController:
    values = {"sample_time": H, "proportional": 0.5, "integral": 2.0, "operating_input": 2.0}
    limits = {"command_min": 1.0, "command_max": 4.0, "closed_loop_time": 0.5}
    return PiController(**(values | limits | changes))


@pytest.mark.parametrize(("lag", "delay"), [(0.2, 0), (0.5, 5), (2.0, 20)])
def test_a_lag_with_a_delay_is_found_again(lag, delay):
    found = reduce_to_first_order(first_order(-3.0, lag, delay))
    assert found.gain == pytest.approx(-3.0)
    assert found.time_constant == pytest.approx(lag, rel=0.01)
    assert found.delay == pytest.approx(delay * H, abs=0.002)


def test_slow_creep_of_a_fast_actuator_is_no_lag():
    # 85 % at once, the rest with 10 s
    slow = np.exp(-H / 10.0)
    linear = LinearModel(
        numerator=[0.0, 0.85 + 0.15 * (1 - slow), -0.85 * slow], denominator=[1.0, -slow],
        covariance=np.zeros((4, 4)), sample_time=H, operating_input=2.0, operating_output=0.0,
    )  # fmt: skip
    assert linear.static_gain == pytest.approx(1.0)
    assert reduce_to_first_order(linear).time_constant < H
    assert lambda_tuning(linear, command_limits=(1.0, 4.0)).proportional == 0.0


def test_gains_follow_the_rule():
    tuned = lambda_tuning(first_order(3.0, 0.5, 4), command_limits=(1.0, 4.0), closed_loop_time=0.3)
    reduced = reduce_to_first_order(first_order(3.0, 0.5, 4))
    assert tuned.integral == pytest.approx(1 / (3.0 * (0.3 + reduced.delay + H / 2)))
    assert tuned.proportional == pytest.approx(reduced.time_constant * tuned.integral)


@pytest.mark.parametrize("gain", [2.0, -2.0])
def test_the_closed_loop_is_as_fast_as_was_asked_for(gain):
    linear = first_order(gain, 0.5, 3)
    tuned = lambda_tuning(linear, command_limits=(1.0, 4.0), closed_loop_time=0.4)
    closed = control.feedback(tuned.to_control() * linear.system())
    response = control.step_response(closed, np.arange(0.0, 6.0, H))
    # First order with lambda = 0.4 s after a delay of 3 samples, within what expanding the delay leaves.
    reached = response.time[np.argmax(response.outputs > 1 - np.exp(-1))]
    assert reached - 3 * H == pytest.approx(0.4, rel=0.15)
    assert response.outputs.max() < 1.05
    assert response.outputs[-1] == pytest.approx(1.0, abs=1e-3)


def test_the_default_crossover_lies_inside_the_excited_band():
    tuned = lambda_tuning(first_order(1.0, 0.005, 0), command_limits=(1.0, 4.0), band_Hz=0.2)
    assert tuned.closed_loop_time == pytest.approx(1 / (2 * np.pi * 0.1))


def test_it_equals_its_transfer_function_while_no_limit_is_reached():
    error = 0.1 * np.random.default_rng(0).normal(size=200)
    controller, memory, commands = pi(), 0.0, []
    for value in error:
        command, memory = controller.command(float(value), memory)
        commands.append(command - 2.0)
    expected = control.forced_response(controller.to_control(), inputs=error).outputs
    np.testing.assert_allclose(commands, expected, atol=1e-12)


def test_limits_hold_and_the_integral_does_not_wind_up():
    controller, memory = pi(), 0.0
    for _ in range(1000):
        command, memory = controller.command(5.0, memory)
        assert command == 4.0
    command, memory = controller.command(-0.5, memory)
    assert command < 4.0
    assert memory <= 2.0


@pytest.mark.parametrize(
    "changes",
    [{"operating_input": 5.0}, {"integral": np.nan}, {"closed_loop_time": 0.0}, {"sample_time": -1.0}],
)
def test_senseless_controllers_are_refused(changes):
    with pytest.raises(ControlError):
        pi(**changes)


def test_a_closed_loop_time_below_a_sample_is_refused():
    with pytest.raises(ControlError, match="at least a sample"):
        lambda_tuning(first_order(1.0, 0.5, 1), command_limits=(1.0, 4.0), closed_loop_time=0.001)
