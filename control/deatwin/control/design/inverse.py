"""Feedback behind the inverse of the actuator's static curve, and the curve of a model or a plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import singledispatch
from typing import Any, Protocol

import numpy as np

from deatwin.control.arguments import function, instance, pair, taking, whole
from deatwin.control.controllers.inverse import InverseController, StaticCurve
from deatwin.control.controllers.law import READING, Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.design.pid import Limits
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.ident.frequency import equilibrium
from deatwin.ident.narx import NarxModel
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.rest import rest_state
from deatwin.plant.rest_path import held_rest


class Design(Protocol):
    """A design function with fixed settings, such as ``partial(lambda_tuning, closed_loop_time=0.5)``."""

    def __call__(self, linear: LinearModel, *, command_limits: Limits) -> LinearController:
        """Design on a model."""
        ...


@singledispatch
def static_curve(system: Any, /, command_range: Limits, *, count: int = 33) -> StaticCurve:
    """Compute the output at rest of an identified model or a plant as a function of the constant command.

    Parameters
    ----------
    system : NarxModel or Plant
        Model or plant with one input and one output.
    command_range : (float, float)
        Least and largest command, in its unit.
    count : int
        Number of evenly spaced commands.

    Raises
    ------
    ControlError
        If an argument is invalid, if the outputs are not strictly monotone, or if the system does not come to rest at
        one of the commands, which the message names.
    """
    raise ControlError(f"a static curve needs a NarxModel or a Plant, not a {type(system).__name__}")


@static_curve.register
def _(system: NarxModel, command_range: Limits, *, count: int = 33) -> StaticCurve:
    if len(system.input_names) != 1:
        raise ControlError(f"the model has {len(system.input_names)} inputs; a static curve is that of one")
    unit = system.input_units[0]

    def output(command: float) -> float:
        try:
            found = equilibrium(system, command)
        except ModelError as error:
            raise ControlError(f"no static curve: at {command:.4g} {unit}".rstrip() + f" {error}") from None
        if not found.is_stable:
            raise ControlError(
                f"no static curve: the model is unstable at {command:.4g} {unit}".rstrip()
                + "; choose a smaller range of the command"
            )
        return found.output

    return _curve(output, command_range, count, unit, system.output_units[0])


@static_curve.register
def _(system: Plant, command_range: Limits, *, count: int = 33) -> StaticCurve:
    equations, values, rig = system.equations, system.free_values, system.rig
    start = rest_state(equations, rig.start.rest_command, values)  # a sensor that is zeroed at rest has its zero here
    guess: Array | None = None

    def output(command: float) -> float:
        nonlocal guess
        rest = rest_state(equations, command, values, guess=guess)
        if not rest.found:
            raise ControlError(
                f"no static curve: the plant has no state of rest at {command:.4g} {rig.input_unit} (pull-in, or the "
                "film is too soft); choose a smaller range of the command"
            )
        guess = np.concatenate([rest.x, rest.z])  # so that the next search stays on the branch
        here, n_x = held_rest(equations, guess, start.d, command, values), len(equations.states)
        inputs = equations.held_inputs(command)
        return float(equations.output(here[:n_x], here[n_x:], start.d, inputs, 0.0, values, equations.constants))

    return _curve(output, command_range, count, rig.input_unit, rig.output_unit)


def _curve(
    output: Callable[[float], float], command_range: Limits, count: int, input_unit: str, output_unit: str
) -> StaticCurve:
    pair(command_range, "command_range")
    whole(2)(count, "count")
    low, high = map(float, command_range)
    if not low < high:
        raise ControlError(f"the range of the command is {low:g} to {high:g}: it must rise")
    inputs = np.linspace(low, high, count)
    return StaticCurve(
        inputs=inputs,
        outputs=np.array([output(float(u)) for u in inputs]),
        input_unit=input_unit,
        output_unit=output_unit,
    )


@taking(linear=linear_model, curve=instance(StaticCurve), design=function, command_limits=pair)
def with_inverse(
    linear: LinearModel, curve: StaticCurve, design: Design, *, command_limits: Limits
) -> InverseController:
    """Design a controller that compensates the static curve of the actuator by its inverse.

    The controller adds a feedback of the error to the reference, and converts the sum to a command by the inverse
    curve.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator at the operating point, with the delay of the loop (`LinearModel.in_loop`).
    curve : StaticCurve
        Static curve of the actuator over a range that contains the operating point.
    design : callable
        Function that designs the feedback, called as ``design(linear, command_limits=(low, high))``. An example is
        ``partial(lambda_tuning, closed_loop_time=0.5)``.
    command_limits : (float, float)
        Least and largest command, in its unit. If the curve covers a smaller range, the limits are those of the curve.

    Returns
    -------
    InverseController
        Controller with the sampling time of the model.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If the operating point lies outside the curve or the command limits, if the slope of the curve and the static
        gain of the model have opposite signs, or if `design` fails.
    """
    low, high = max(command_limits[0], curve.inputs[0]), min(command_limits[1], curve.inputs[-1])
    point = linear.require().operating_input
    if not low < point < high:
        raise ControlError(
            f"the operating input {point:g} must lie inside the limits and the static curve, {low:g} to {high:g}"
        )
    slope = float(curve.slope(point))
    if not slope * linear.static_gain > 0.0:
        raise ControlError(
            f"the static curve rises by {slope:.4g} at {point:g} and the model by {linear.static_gain:.4g}: "
            "their signs must agree"
        )
    demands = sorted(float(v) for v in curve.output([low, high]))
    found = design(_behind(linear, curve, slope), command_limits=(demands[0], demands[1]))
    if not isinstance(found, LinearController):
        raise ControlError(f"a {type(found).__name__} cannot be the feedback of an inverse: design a LinearController")
    law = Law.of_error(found.law.a, -found.law.b[:, READING], found.law.c, -float(found.law.d[READING]))
    feedback = replace(found, law=law.feedforward(1.0))
    return InverseController(
        name=f"{found.name} behind the inverse",
        sample_time=found.sample_time,
        operating_input=point,
        operating_output=linear.rest_output,
        command_min=low,
        command_max=high,
        closed_loop_time=found.closed_loop_time,
        feedback=feedback,
        curve=curve,
    )


def _behind(linear: LinearModel, curve: StaticCurve, slope: float) -> LinearModel:
    """Return the model from a desired output to the output, with the inverse curve in front."""
    scale = np.ones(len(linear.covariance))
    scale[: linear.numerator.size] = 1.0 / slope
    return replace(
        linear,
        numerator=linear.numerator / slope,
        covariance=linear.covariance * np.outer(scale, scale),
        operating_input=float(curve.output(linear.operating_input)),
        input_name="demand",
        input_unit=linear.output_unit,
        realisation=linear.realisation and linear.realisation.scaled(1.0 / slope),
    )
