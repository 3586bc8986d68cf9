"""Judge whether the loop can oscillate by itself, from describing functions of plant, command limits and quantisers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from deatwin.control.checking.amounts import amount
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.verdict import Finding, worst
from deatwin.control.controllers.base import Controller, room_of
from deatwin.control.linear.model import LinearModel
from deatwin.control.loop.sine_response import SineResponse, sine_response
from deatwin.control.progress import Progress
from deatwin.control.stability.limit_cycles import LimitCycle, LimitCycles, limit_cycles
from deatwin.control.stability.loops import loop_margins
from deatwin.control.stability.polynomials import in_series
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.model import Plant
from deatwin.plant.words import listed

SIZES = (0.02, 0.06, 0.2, 0.6, 0.95)
"""Amplitudes of the command at which the plant is measured, as shares of the distance to its limits."""
FREQUENCIES = 10
_LOWEST = 0.3  # Lowest frequency searched, as a share of the crossover; the phase reaches half a turn above that
_SLUGGISH = 20.0  # Time constant of the slowest crossover, in closed-loop times; slower loops are treated like this one
_FINE = 60  # Number of points on each axis of the grid on which cycles are searched
_LARGEST = 30.0  # Largest amplitude of a saturated command that is searched, in units of its limit


def judge_cycles(
    plant: Plant,
    controller: Controller,
    linear: LinearModel,
    step: float,
    specification: Specification,
    *,
    progress: Progress | None = None,
) -> Finding:
    """Judge the limit cycles that describing functions predict."""
    highest = 0.9 * np.pi / controller.sample_time
    omega = np.geomspace(min(_LOWEST * _crossover(controller, linear), 0.5 * highest), highest, FREQUENCIES)
    sizes = room_of(controller) * np.array(SIZES)
    response = sine_response(plant, controller.operating_input, sizes, omega, progress=progress)
    found = [
        *_that_matter(_of_plant(response, controller, omega)),
        *_that_matter(_of_limits(controller, linear, omega)),
        *_that_matter(_of_codes(plant, controller, linear, omega)),
    ]
    judged = [_judged(what, cycle, amplitude / abs(step), specification) for what, cycle, amplitude in found]
    if response is None:
        return _with_plant_unmeasured(judged)
    finding = worst(judged) if judged else _none("the plant, the command limits and the sensor's resolution")
    return replace(finding, text=finding.text + _sizes_measured(response))


_Found = tuple[str, LimitCycle, float]
"""Cause of a limit cycle, the cycle, and its amplitude at the output, in its unit."""


def _judged(what: str, cycle: LimitCycle, share: float, specification: Specification) -> Finding:
    limit = specification.limit_cycle if cycle.stable else specification.safe_region
    verdict = limit.judge(share)
    wanted = "" if verdict is Verdict.PASS else f" (required: {limit.wanted} of a step)"
    kind = (
        "a limit cycle"
        if cycle.stable
        else "an unstable limit cycle (the loop does not return to rest from larger amplitudes)"
    )
    text = (
        f"{kind} is predicted (by describing functions) at {cycle.frequency_Hz:.2g} Hz, with an "
        f"amplitude of {amount(100 * share, '.3g', ' %')} of a step, because of {what}{wanted}"
    )
    subject = "limit cycle" if cycle.stable else "unstable limit cycle"
    return Finding(subject=subject, value=share, verdict=verdict, text=text)


def _none(of: str) -> Finding:
    text = f"no limit cycle is predicted (by describing functions of {of})"
    return Finding(subject="limit cycle", value=0.0, verdict=Verdict.PASS, text=text)


def _with_plant_unmeasured(judged: list[Finding]) -> Finding:
    """Return the worst finding on limits and codes; at best marginal, because the plant itself was not measured."""
    least = f"{100 * SIZES[1]:g} % of the distance to the command's limits"
    why = f"the plant model itself was not tested, because its simulation fails even under sines of {least}"
    # Without a cycle the finding has no number; zero would be one.
    finding = worst(judged) if judged else replace(_none("the command limits and the sensor's resolution"), value=None)
    verdict = max(finding.verdict, Verdict.MARGINAL, key=lambda verdict: verdict.severity)
    return replace(finding, verdict=verdict, text=f"{finding.text}; {why}")


def _sizes_measured(response: SineResponse) -> str:
    """Return a remark if the plant failed under the larger sines."""
    lived = [f"{100 * size:g}" for size in SIZES[: response.amplitudes.size]]
    if len(lived) == len(SIZES):
        return ""
    sizes = f"{listed(lived)} % of the distance to the command's limits"
    return f"; the plant model was tested only with sines of {sizes}, because its simulation fails under larger ones"


def _that_matter(found: list[_Found]) -> list[_Found]:
    """Keep all sustained cycles, and each unstable one beyond which no sustained cycle limits the oscillation."""
    caught = max((amplitude for _, cycle, amplitude in found if cycle.stable), default=0.0)
    return [entry for entry in found if entry[1].stable or entry[2] > caught]


def _of_plant(response: SineResponse | None, controller: Controller, omega: Array) -> list[_Found]:
    if response is None:
        return []
    top, bottom = controller.local(controller.operating_input).feedback
    sizes = np.geomspace(response.amplitudes[0], response.amplitudes[-1], _FINE)
    cycles = limit_cycles(top, bottom, controller.sample_time, response, sizes, _between(omega))
    gains = [np.abs(response(c.amplitude, 2 * np.pi * c.frequency_Hz)).item() for c in cycles]
    return [("the plant's own nonlinearity", c, c.amplitude * g) for c, g in zip(cycles, gains, strict=True)]


def _of_limits(controller: Controller, linear: LinearModel, omega: Array) -> list[_Found]:
    room = room_of(controller)
    sizes = np.geomspace(1.001 * room, _LARGEST * room, _FINE)
    cycles = _around(controller, linear, omega, sizes, partial(saturation, room))
    return [("the limits of the command", c, _after(room, c, linear)) for c in cycles]


def _of_codes(plant: Plant, controller: Controller, linear: LinearModel, omega: Array) -> list[_Found]:
    if plant.rig.chain is None:
        return []
    step = plant.rig.chain.reading_step
    sizes = np.geomspace(0.51 * step, 20.0 * step, _FINE)
    cycles = _around(controller, linear, omega, sizes, partial(quantiser, step))
    return [("the resolution of the sensor's converter", c, c.amplitude) for c in cycles]


def _around(
    controller: Controller, linear: LinearModel, omega: Array, sizes: Array, describing: Callable[[Array], Complex]
) -> LimitCycles:
    """Return the limit cycles of the linear loop with a nonlinearity of any frequency. Shapes: `omega, sizes` (n,)."""
    top, bottom = controller.local(controller.operating_input).feedback
    loop = in_series(linear.numerator, top), in_series(linear.denominator, bottom)
    return limit_cycles(*loop, controller.sample_time, lambda size, _: describing(size), sizes, _between(omega))


def _crossover(controller: Controller, linear: LinearModel) -> float:
    """Return the crossover of the linear loop, rad/s; if its gain is never one, the requested bandwidth."""
    # The crossover of a controller that hardly acts may have a period of days, longer than any run.
    found = float(loop_margins(linear, controller.local(controller.operating_input)).crossover[0])
    asked = 1.0 / controller.closed_loop_time
    return max(found or asked, asked / _SLUGGISH)


def _after(room: float, cycle: LimitCycle, linear: LinearModel) -> float:
    """Return the amplitude of a cycle after the limits, given the amplitude before them."""
    amplitude, omega = np.asarray(cycle.amplitude), 2 * np.pi * cycle.frequency_Hz
    passed = saturation(room, amplitude) * linear.response([omega])[0]
    return float(cycle.amplitude * np.abs(passed))


def _between(omega: Array) -> Array:
    return np.geomspace(omega[0], omega[-1], _FINE)


def saturation(limit: float, amplitude: Array) -> Complex:
    """Return N of a saturation, with a gain of one up to a limit. Shapes: returns that of `amplitude`."""
    x = np.minimum(limit / amplitude, 1.0)
    return np.asarray(2.0 / np.pi * (np.arcsin(x) + x * np.sqrt(1.0 - x**2)), dtype=np.complex128)


def quantiser(step: float, amplitude: Array) -> Complex:
    """Return N of rounding to multiples of a step, shaped as `amplitude`: a relay of one step at each edge."""
    ratio = np.asarray(amplitude / step)[..., None]
    edges = np.arange(np.floor(ratio.max() + 0.5)) + 0.5
    gain = np.sum(np.sqrt(np.maximum(1.0 - (edges / ratio) ** 2, 0.0)), axis=-1)
    return np.asarray(4.0 / (np.pi * ratio[..., 0]) * gain, dtype=np.complex128)
