"""Combine designs at several operating points into one controller."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.control.arguments import each, finite, function, pair, taking
from deatwin.control.controllers.linear import LinearController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.design.inverse import Design
from deatwin.control.design.pid import Limits
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.plant.errors import ModelError


@taking(models=each(linear_model), design=function, command_limits=pair, operating_input=finite)
def scheduled(
    models: Sequence[LinearModel], design: Design, *, command_limits: Limits, operating_input: float | None = None
) -> ScheduledController:
    """Design a controller at each of several operating points and interpolate between them.

    Parameters
    ----------
    models : sequence of LinearModel
        Two or more models at different operating inputs, with the delay of the loop (`LinearModel.in_loop`).
    design : callable
        Function that designs a controller, called as ``design(linear, command_limits=(low, high))``. An example is
        ``partial(lambda_tuning, closed_loop_time=0.5)``. It must return PI controllers for all models, or PID
        controllers for all models.
    command_limits : (float, float)
        Least and largest command, in its unit. A model's operating input may equal one of the limits.
    operating_input : float, optional
        Constant input about which the loop is closed. It must be the operating input of one of the models, strictly
        between the limits; by default that of the middle model.

    Returns
    -------
    ScheduledController
        Controller with the sampling time of the models. Its closed-loop time is the longest of the individual designs.

    Raises
    ------
    ControlError
        If the models differ in sampling time or in the sign of the static gain, if the design fails for one of the
        models (the message says which, and why), if the controllers are not of one kind, or if an argument is invalid.
    """
    if not command_limits[0] < command_limits[1]:
        raise ControlError(f"the limits of the command, {command_limits[0]:g} and {command_limits[1]:g}, must rise")
    if len(models) < 2:
        raise ControlError(f"a schedule needs two or more operating points; there are {len(models)}")
    ordered = sorted(models, key=lambda model: model.operating_input)
    times = {model.sample_time for model in ordered}
    if len(times) > 1:
        raise ControlError(f"the models of a schedule must have one sample time; they have {sorted(times)} s")
    found = [_designed(model, design, command_limits) for model in ordered]
    signs = [float(np.sign(model.static_gain)) for model in ordered]
    for before, after, change in zip(ordered, ordered[1:], np.diff(signs), strict=False):
        if change != 0.0:
            raise ControlError(
                f"the static gain changes its sign between {before.operating_input:g} and {after.operating_input:g} "
                f"{after.input_unit}".rstrip()
                + ": no controller serves both; choose a range on one side"
            )
    if len({c.law.c.size for c in found}) > 1:
        kinds = ", ".join(f"{c.name} at {c.operating_input:g}" for c in found)
        raise ControlError(f"the laws of a schedule must have one structure; the design gave {kinds}")
    centre = _centre(found, operating_input)
    names = sorted({c.name for c in found}, key=len)
    return ScheduledController(
        name=f"scheduled {names[-1]}",
        sample_time=centre.sample_time,
        operating_input=centre.operating_input,
        operating_output=centre.operating_output,
        command_min=float(command_limits[0]),
        command_max=float(command_limits[1]),
        closed_loop_time=max(c.closed_loop_time for c in found),
        points=np.array([c.operating_input for c in found]),
        laws=tuple(c.law for c in found),
        windup=np.array([c.windup for c in found]),
    )


def _designed(model: LinearModel, design: Design, command_limits: Limits) -> LinearController:
    # Only the law of the design is used, so its limits are widened: a law may be wanted at a limit itself.
    low, high = command_limits
    room = (min(low, model.operating_input) - (high - low), max(high, model.operating_input) + (high - low))
    try:
        return design(model, command_limits=room)
    except (ModelError, ControlError) as error:
        where = f"{model.operating_input:g} {model.input_unit}".rstrip()
        raise ControlError(f"no design at {where}: {error}") from None


def _centre(found: Sequence[LinearController], operating_input: float | None) -> LinearController:
    if operating_input is None:
        return found[len(found) // 2]
    for controller in found:
        if abs(controller.operating_input - operating_input) <= 1e-9 * max(abs(operating_input), 1.0):
            return controller
    points = ", ".join(f"{c.operating_input:g}" for c in found)
    raise ControlError(f"the loop cannot be closed at {operating_input:g}: there are models at {points}")
