"""Whether the loop may oscillate by itself: describing functions of plant, limits, and codes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.model import LinearModel
from deatwin.control.loop.sine_response import sine_response
from deatwin.control.stability.describing import Quantiser, Saturation
from deatwin.control.stability.limit_cycles import LimitCycle, limit_cycles
from deatwin.control.stability.polynomials import in_series
from deatwin.plant.model import Plant

__all__ = ["judge_cycles"]

Array = NDArray[np.float64]

SIZES = (0.02, 0.06, 0.2, 0.6, 0.95)
"""Amplitudes of the command at which the plant is measured, as shares of the room to its limits."""
FREQUENCIES = 10
_FINE = 60  # points of each axis on which cycles are looked for
_LARGEST = 30.0  # times the limit: how far beyond it a saturated command is looked at


def judge_cycles(
    plant: Plant, controller: Controller, linear: LinearModel, step: float, specification: Specification
) -> Finding:
    """Judge the limit cycles that describing functions predict.

    Three loops are looked at: the plant's own response to sines of all sizes, with whatever friction, hysteresis,
    slew or curvature its effects bring; the command's limits before the linear model; and the codes of the
    sensor's converter after it.

    Parameters
    ----------
    plant : Plant
        The physics.
    controller : Controller
        In the loop.
    linear : LinearModel
        As the controller sees it.
    step : float
        With which a cycle's amplitude is compared, in the output's unit.
    specification : Specification
        What is asked.

    Returns
    -------
    Finding
        Of the largest cycle at the output, sustained or at the edge of what it starts from.
    """
    omega = np.geomspace(0.1 / controller.closed_loop_time, 0.9 * np.pi / controller.sample_time, FREQUENCIES)
    found = [
        *_of_plant(plant, controller, omega),
        *_of_limits(controller, linear, omega),
        *_of_codes(plant, controller, linear, omega),
    ]
    if not found:
        text = "describing functions of plant, limits and codes predict no limit cycle"
        return Finding(subject="limit cycle", value=0.0, verdict=Verdict.PASS, text=text)
    what, cycle, amplitude = max(found, key=lambda entry: entry[2])
    share = amplitude / abs(step)
    kind = "a" if cycle.stable else "an unstable"
    verdict = specification.limit_cycle.judge(share)
    wanted = "" if verdict is Verdict.PASS else f" ({specification.limit_cycle.wanted} of a step is wanted)"
    text = (
        f"describing functions predict {kind} limit cycle at {cycle.frequency_Hz:.2g} Hz of {100 * share:.0f} % of a "
        f"step, by {what}{wanted}"
    )
    return Finding(subject="limit cycle", value=share, verdict=verdict, text=text)


_Found = tuple[str, LimitCycle, float]
"""What makes the cycle, the cycle, and its amplitude at the output, in its unit."""


def _of_plant(plant: Plant, controller: Controller, omega: Array) -> list[_Found]:
    room = min(controller.operating_input - controller.command_min, controller.command_max - controller.operating_input)
    response = sine_response(plant, controller.operating_input, room * np.array(SIZES), omega)
    if response is None:
        return []
    top, bottom = controller.local(controller.operating_input).feedback
    sizes = np.geomspace(response.amplitudes[0], response.amplitudes[-1], _FINE)
    cycles = limit_cycles(top, bottom, controller.sample_time, response, sizes, _between(omega))
    gains = [np.abs(response(c.amplitude, 2 * np.pi * c.frequency_Hz)).item() for c in cycles]
    return [("the plant's own nonlinearity", c, c.amplitude * g) for c, g in zip(cycles, gains, strict=True)]


def _of_limits(controller: Controller, linear: LinearModel, omega: Array) -> list[_Found]:
    room = min(controller.operating_input - controller.command_min, controller.command_max - controller.operating_input)
    top, bottom = _loop(controller, linear)
    sizes = np.geomspace(1.001 * room, _LARGEST * room, _FINE)
    limits = Saturation(limit=room)
    cycles = limit_cycles(top, bottom, controller.sample_time, limits, sizes, _between(omega))
    return [("the limits of the command", c, _after(limits, c, linear)) for c in cycles]


def _of_codes(plant: Plant, controller: Controller, linear: LinearModel, omega: Array) -> list[_Found]:
    if plant.rig.chain is None:
        return []
    step = plant.rig.chain.reading_step
    top, bottom = _loop(controller, linear)
    sizes = np.geomspace(0.51 * step, 20.0 * step, _FINE)
    cycles = limit_cycles(top, bottom, controller.sample_time, Quantiser(step=step), sizes, _between(omega))
    return [("the codes of the sensor's converter", c, c.amplitude) for c in cycles]


def _loop(controller: Controller, linear: LinearModel) -> tuple[Array, Array]:
    top, bottom = controller.local(controller.operating_input).feedback
    return in_series(linear.numerator, top), in_series(linear.denominator, bottom)


def _after(limits: Saturation, cycle: LimitCycle, linear: LinearModel) -> float:
    """Amplitude at the output of a cycle whose amplitude is known before the limits."""
    omega = 2 * np.pi * cycle.frequency_Hz
    passed = limits(cycle.amplitude, omega) * linear.response([omega])[0]
    return float(cycle.amplitude * np.abs(passed))


def _between(omega: Array) -> Array:
    return np.geomspace(omega[0], omega[-1], _FINE)
