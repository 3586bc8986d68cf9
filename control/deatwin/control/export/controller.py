"""A controller as C source, with limits and anti-windup, for the micro-controller that drives the actuator.

The code is that of `Controller.command`. If a reference or reading is not finite, command and state stay unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.inverse import InverseController, StaticCurve
from deatwin.control.controllers.linear import LinearController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.errors import ControlError
from deatwin.control.export import templates
from deatwin.plant.export.sampled import SampledSource, Signal, comment, filled, require_identifier, table

_COMMON = ("operating_input", "operating_output", "command_min", "command_max", "sample_time")


def controller_source(
    controller: Controller, *, name: str = "controller", input_unit: str = "", output_unit: str = ""
) -> SampledSource:
    """Generate C source that computes a controller's command from reference and reading at each sample.

    Parameters
    ----------
    controller : Controller
        Linear, inverse or scheduled controller.
    name : str
        Prefix of all names in the source.
    input_unit, output_unit : str
        Units for the comments in the source: `input_unit` is the unit of the command, `output_unit` that of reference
        and reading.

    Returns
    -------
    SampledSource
        C source. Its function takes reference and reading in the array ``u``, and returns the command in ``y``.

    Raises
    ------
    ModelError
        If the name is not a C identifier.
    ControlError
        If the controller is of a user-defined kind.
    """
    require_identifier(name)
    fields: dict[str, object] = {key: float(getattr(controller, key)) for key in _COMMON}
    fields |= {"n": name, "N": name.upper(), "states": controller.states, "size": max(controller.states, 1)}
    parts, tables = _parts(controller, fields)
    written = "\n".join(table(f"{name}_real {name}_{key}", values) for key, values in tables.items())
    inputs = tuple(
        Signal(name=n, unit=output_unit, start=controller.operating_output) for n in ("reference", "reading")
    )
    outputs = (Signal(name="command", unit=input_unit, start=controller.operating_input),)
    body = "".join(filled(part, **fields, tables=written) for part in (templates.HEAD, *parts))
    return SampledSource(
        name=name,
        text=_head(controller, inputs[0], outputs[0]) + body,
        sample_time=controller.sample_time,
        inputs=inputs,
        outputs=outputs,
        description=f"{controller.name} controller ({controller.kind})",
    )


def _parts(controller: Controller, fields: dict[str, object]) -> tuple[tuple[str, ...], Mapping[str, ArrayLike]]:
    """Return the templates after the head, and constant arrays; the numbers of this controller fill the fields."""
    if isinstance(controller, LinearController):
        fields |= _inner(controller)
        return (templates.LAW, templates.LINEAR_STEP), _law_tables(controller)
    if isinstance(controller, InverseController):
        fields |= _inner(controller.feedback)
        fields |= {"pieces": controller.curve.inputs.size - 1, "largest": float(np.abs(controller.curve.inputs).max())}
        fields |= {"rising": 1 if controller.curve.outputs[-1] > controller.curve.outputs[0] else -1}
        tables = {**_law_tables(controller.feedback), **_curve_tables(controller.curve)}
        return (templates.LAW, templates.CURVE, templates.INVERSE_STEP), tables
    if isinstance(controller, ScheduledController):
        states = controller.states - 1  # the last state is the smoothed command
        follow = min(controller.sample_time / controller.closed_loop_time, 1.0)
        fields |= {"states": states, "size": max(states, 1), "last": controller.points.size - 1, "follow": follow}
        return (templates.SCHEDULE, templates.SCHEDULED_STEP), _schedule_tables(controller)
    raise ControlError(
        f"a controller of the kind {controller.kind!r} has no C source; linear, inverse and scheduled ones have"
    )


def _inner(controller: LinearController) -> dict[str, object]:
    """Return centre and limits of the law's own command; with an inverse curve, this command is a desired output."""
    return {
        "centre": float(controller.operating_input),
        "low": float(controller.command_min),
        "high": float(controller.command_max),
    }


def _law_tables(controller: LinearController) -> dict[str, ArrayLike]:
    law = controller.law
    return {"a": law.a, "b": law.b, "c": law.c, "d": law.d, "l": controller.windup}


def _curve_tables(curve: StaticCurve) -> dict[str, ArrayLike]:
    """Return the points of the curve and the coefficients of the monotone cubic after each, highest power first."""
    from scipy.interpolate import PchipInterpolator

    cubic = PchipInterpolator(curve.inputs, curve.outputs)
    return {"inputs": curve.inputs, "outputs": curve.outputs, "cubic": cubic.c.T}


def _schedule_tables(controller: ScheduledController) -> dict[str, ArrayLike]:
    laws = {key: np.stack([getattr(law, key) for law in controller.laws]) for key in ("a", "b", "c", "d")}
    return {"points": controller.points, **laws, "l": controller.windup}


def _head(controller: Controller, asked: Signal, command: Signal) -> str:
    unit = f" {command.unit}" if command.unit else ""
    return comment(
        [
            f"{controller.name} controller ({controller.kind}), with one sample of {controller.sample_time:g} s per call.",
            f"u[0] is the {asked}; u[1] is the reading, in the same unit; y[0] is the {command}.",
            f"The command stays between {controller.command_min:g} and {controller.command_max:g}{unit}; the loop is to be "
            f"closed when the actuator rests at {controller.operating_input:g}{unit}.",
            "Do not compile with -ffast-math, which disables the test for readings that are not finite.",
        ]
    )
