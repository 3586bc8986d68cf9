"""Compare tracking by PI alone, by PI behind the inverse static curve, and by designs on the true plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from deatwin.control import (
    ClosedLoop,
    Controller,
    Margins,
    closed_loop,
    inverse_filter,
    lambda_tuning,
    linearise,
    linearise_plant,
    scheduled,
    static_curve,
    step_reference,
    tone_reference,
    with_dynamics,
    with_inverse,
)
from deatwin.control.stability.loops import loop_margins
from deatwin.plant import Actuator, Plant, fleet, specification
from deatwin.plant.arrays import Array
from deatwin.plant.excitation import band_limited_noise
from deatwin.scenarios.control_check.trials import LIMITS, identified, recorded

OPERATING = 2.8
BAND = (0.1, 0.8)  # Frequencies of the reference, Hz
EXCITED = 4.0
"""Upper end of the noise for rigs with hysteresis, Hz: the thesis' 1 Hz leaves the models' crossover to chance."""
TONES = 8
SECONDS = 60.0
SETTLED = 5.0  # From when on errors count, s
CLOSED_LOOP_TIME = 0.3
SCHEDULE = np.linspace(1.5, 3.4, 6)  # Operating inputs of the scheduled design, V
_design = partial(lambda_tuning, closed_loop_time=CLOSED_LOOP_TIME)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """A controller with its run on the reference."""

    controller: Controller
    run: ClosedLoop
    margins: Margins

    @property
    def rms(self) -> float:
        """Rms error after the start, in the output's unit."""
        late = self.run.timepts >= SETTLED
        return float(np.sqrt(np.mean(self.run.error[late] ** 2))) if late.any() else np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracking:
    """Tracking errors of all controllers on one plant."""

    name: str
    tracked: Mapping[str, Tracked]

    def ratio(self, one: str, other: str) -> float:
        """Return the rms error of one controller divided by that of another."""
        return self.tracked[one].rms / self.tracked[other].rms

    @property
    def best(self) -> float:
        """Smallest rms error of a design on the true plant, in the output's unit."""
        return min(one.rms for name, one in self.tracked.items() if name.startswith("oracle"))


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetRun:
    """The scheduled design on one actuator."""

    actuator: Actuator  # One of the six
    steps: ClosedLoop  # Over the range of the schedule
    tones: ClosedLoop

    @property
    def stable(self) -> bool:
        """True if both runs reached their end and no oscillation remains long after a step."""
        return self.steps.status.ok and self.tones.status.ok and self.steps.ripple < 0.1


def track(name: str, plant: Plant, rng: np.random.Generator, excited_Hz: float = 1.0) -> Tracking:
    """Identify a plant, design, and track tones. `excited_Hz` upper end of the recording's noise, Hz."""
    h = plant.rig.sample_time
    recording = recorded(plant, band_limited_noise(rng, 120.0, h, band=excited_Hz), rng)
    model = identified(recording)
    mine = linearise(model, OPERATING).in_loop(plant.rig.reading)
    true = linearise_plant(plant, OPERATING).in_loop(plant.rig.reading)
    curves = {"": static_curve(model, LIMITS), "oracle: ": static_curve(plant, LIMITS)}
    designs: dict[str, Controller] = {"PI": _design(mine, command_limits=LIMITS)}
    for who, linear in (("", mine), ("oracle: ", true)):
        behind = with_inverse(linear, curves[who], _design, command_limits=LIMITS)
        designs[f"{who}inverse"] = behind
        designs[f"{who}inverse with dynamics"] = with_dynamics(behind, inverse_filter(linear, BAND[1] / 0.8))
    reference = _tones(curves["oracle: "].output(OPERATING), curves["oracle: "].output(LIMITS), h, rng)
    noise = int(rng.integers(2**32))
    return Tracking(
        name=name,
        tracked={
            key: Tracked(
                controller=controller,
                margins=loop_margins(mine, controller.local(controller.operating_input)),
                run=closed_loop(plant, controller, reference, rng=np.random.default_rng(noise)),
            )
            for key, controller in designs.items()
        },
    )


def fleet_runs(seed: int, rng: np.random.Generator) -> tuple[FleetRun, ...]:
    """Schedule a design on the model of the specification, and close the loop on the six actuators."""
    wished = specification()
    h, reading = wished.rig.sample_time, wished.rig.reading
    model = identified(recorded(wished, band_limited_noise(rng, 120.0, h, band=EXCITED), rng))
    points = [linearise(model, float(u)).in_loop(reading) for u in SCHEDULE]
    controller = scheduled(points, _design, command_limits=LIMITS)
    curve = static_curve(model, LIMITS)
    low, centre, high = (float(curve.output(u)) for u in (SCHEDULE[0], OPERATING, SCHEDULE[-1]))
    amplitude = 0.9 * min(centre - low, high - centre)
    plateau = round(20.0 * CLOSED_LOOP_TIME / h)
    steps = step_reference(centre, amplitude, plateau, rise=round(CLOSED_LOOP_TIME / h))
    tones = _tones(centre, np.array([low, high]), h, rng)
    return tuple(
        FleetRun(
            actuator=actuator,
            steps=closed_loop(actuator.plant, controller, steps, rng=rng),
            tones=closed_loop(actuator.plant, controller, tones, rng=rng),
        )
        for actuator in fleet(seed)
    )


def _tones(centre: Array | float, ends: Array, sample_time: float, rng: np.random.Generator) -> Array:
    """Return tones that use 60 % of the distance from the centre to the nearer end."""
    amplitude = 0.6 * float(np.abs(np.asarray(ends) - centre).min())
    frequencies = np.linspace(*BAND, TONES)
    return tone_reference(float(centre), amplitude, frequencies, sample_time, round(SECONDS / sample_time), rng)
