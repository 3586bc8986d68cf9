"""Static curves of models and plants, and feedback behind their inverse."""

from dataclasses import replace
from functools import partial

import control
import numpy as np
import pytest

from deatwin.control import ControlError, StaticCurve, lambda_tuning, linearise
from deatwin.control.design.inverse import static_curve, with_inverse
from deatwin.control.design.lqg import lqg
from deatwin.ident.frequency import equilibrium

H = 0.02
LIMITS = (1.1, 3.75)
PARTS = pytest.mark.parametrize("sign", [1.0, -1.0])


def parabola(sign: float) -> StaticCurve:
    inputs = np.linspace(1.0, 4.0, 61)
    return StaticCurve(inputs=inputs, outputs=sign * 0.25 * inputs**2, input_unit="V", output_unit="um")


def behind(sampled, sign, lags=(0.3,), delay=1):
    """A lag behind the parabola, about 2 V, where the curve rises by one."""
    return replace(sampled(sign, lags, delay=delay), operating_output=sign * 1.0)


def simulated(linear, curve, controller, reference):
    """Output of the loop around the curve, followed by the dynamics of the model with a static gain of one."""
    top, bottom = linear.numerator / linear.static_gain, linear.denominator
    rest = float(curve.output(controller.operating_input))
    inputs, past, state, readings = np.zeros(top.size), np.zeros(bottom.size - 1), controller.start(), []
    for asked in reference:
        inputs[1:] = inputs[:-1]
        reading = top[1:] @ inputs[1:] - bottom[1:] @ past
        past = np.append(reading, past[:-1])
        command, state = controller.command(asked, rest + reading, state)
        inputs[0] = float(curve.output(command)) - rest
        readings.append(rest + reading)
    return np.array(readings)


@PARTS
@pytest.mark.parametrize("design", [partial(lambda_tuning, closed_loop_time=0.4), partial(lqg, closed_loop_time=0.4)])
def test_behind_the_inverse_a_curved_actuator_is_linear(sampled, sign, design):
    linear, curve = behind(sampled, sign), parabola(sign)
    controller = with_inverse(linear, curve, design, command_limits=LIMITS)
    # Half the range of the curve: by python-control from the feedback alone, with the model's gain of one.
    reference = sign * (1.0 + np.where(np.arange(400) < 20, 0.0, 1.2))
    plant = control.ss(linear.state_space() / linear.static_gain, inputs=["command"], outputs=["reading"], name="plant")
    law = control.ss(controller.feedback.law.to_control(H), name="law")
    loop = control.interconnect([plant, law], inputs=["reference"], outputs=["reading"])
    expected = np.ravel(control.forced_response(loop, inputs=reference - sign).outputs) + sign
    np.testing.assert_allclose(simulated(linear, curve, controller, reference), expected, atol=1e-9)
    assert expected[-1] == pytest.approx(2.2 * sign, rel=1e-3)


@PARTS
def test_the_loop_gain_is_the_same_at_all_operating_points(sampled, sign):
    curve = parabola(sign)
    controller = with_inverse(
        behind(sampled, sign), curve, partial(lambda_tuning, closed_loop_time=0.4), command_limits=LIMITS
    )
    loops = [controller.local(u).feedback[0] * float(curve.slope(u)) for u in (1.2, 2.0, 3.0, 3.7)]
    for loop in loops[1:]:
        np.testing.assert_allclose(loop, loops[0], rtol=1e-12)


@PARTS
def test_its_feedback_is_the_design_on_the_model_without_the_curves_slope(sampled, sign):
    linear = behind(sampled, 3.0 * sign)
    controller = with_inverse(
        linear, parabola(sign), partial(lambda_tuning, closed_loop_time=0.4), command_limits=LIMITS
    )
    alone = lambda_tuning(linear, command_limits=LIMITS, closed_loop_time=0.4)
    # At the operating point both loops are the same: what the curve took off the model it adds to the law.
    np.testing.assert_allclose(controller.local(2.0).feedback[0], alone.law.feedback[0], rtol=1e-3)  # of the cubic
    forward = controller.feedback.law.prefilter[0] - controller.feedback.law.feedback[0]
    np.testing.assert_allclose(forward, controller.feedback.law.feedback[1], atol=1e-12)


@PARTS
def test_demands_end_where_the_commands_do(sampled, sign):
    curve = parabola(sign)
    controller = with_inverse(behind(sampled, sign), curve, lambda_tuning, command_limits=LIMITS)
    demands = sorted(sign * 0.25 * np.array(LIMITS) ** 2)
    found = (controller.feedback.command_min, controller.feedback.command_max)
    assert found == pytest.approx(demands, rel=1e-4)
    state = controller.start()
    for asked, limit in ((100.0, 3.75), (-100.0, 1.1)):
        command, _ = controller.command(sign * asked, sign, state)
        assert float(command) == pytest.approx(limit, rel=1e-12)


def test_a_curve_shorter_than_the_limits_sets_them(sampled):
    controller = with_inverse(behind(sampled, 1.0), parabola(1.0), lambda_tuning, command_limits=(0.0, 9.0))
    assert (controller.command_min, controller.command_max) == (1.0, 4.0)


def test_an_operating_point_off_the_curve_and_a_curve_against_the_model_are_refused(sampled):
    linear = behind(sampled, 1.0)
    for model, curve, says in (
        (replace(linear, operating_input=0.5), parabola(1.0), "must lie inside the limits and the static curve"),
        (linear, parabola(-1.0), "signs must agree"),
    ):
        with pytest.raises(ControlError, match=says):
            with_inverse(model, curve, lambda_tuning, command_limits=LIMITS)


def test_the_curve_of_a_model_goes_through_its_equilibria(model):
    curve = static_curve(model, LIMITS, count=9)
    for u, y in zip(curve.inputs, curve.outputs, strict=True):
        assert y == equilibrium(model, u).output
    linear = linearise(model)
    # Between points 0.33 V apart the cubic's slope is off by some percent.
    assert float(curve.slope(linear.operating_input)) == pytest.approx(linear.static_gain, rel=0.05)


def test_the_curve_of_a_plant_is_where_it_comes_to_rest(plant):
    curve = static_curve(plant, LIMITS, count=5)
    for u, y in zip(curve.inputs[1::2], curve.outputs[1::2], strict=True):
        stepper = plant.simulator.stepper(plant.free_values, rest_command=0.0, start=0.0, sample_time=H)
        for _ in range(500):  # 10 s: the film's slowest branch has long settled
            stepper.advance(float(u))
        assert stepper.reading == pytest.approx(y, rel=1e-3)
    assert (curve.input_unit, curve.output_unit) == (plant.rig.input_unit, plant.rig.output_unit)


def test_what_pulls_in_or_turns_has_no_curve_and_nothing_else_has_one(plant, model):
    for source, limits, count, says in (
        (plant, (1.1, 40.0), 20, r"no state of rest at|turns at"),
        (model, (-4.0, 4.0), 17, r"turns at|no static curve"),  # a parabola in the command: it turns near 0 V
        ("model", LIMITS, 9, "NarxModel or a Plant, not a str"),
    ):
        with pytest.raises(ControlError, match=says):
            static_curve(source, limits, count=count)
