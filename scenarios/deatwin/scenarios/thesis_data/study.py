"""The experiments of the story: six recordings, loops of each actuator, and loops of the specification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.curves import loop_area
from deatwin.ident.parallel import run_jobs
from deatwin.plant.excitation import triangles
from deatwin.plant.fleet import DURATION, Actuator, fleet, specification
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

LOOP_RATE = 0.01
"""Of the actuators' loops, Hz."""
RATES = (0.1, 0.01, 0.001)
"""Of the specification's, Hz."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """One cycle of a triangle."""

    rate: float  # Hz
    commands: NDArray[np.float64]  # shape (n,): V and m
    displacements: NDArray[np.float64]

    @property
    def area(self) -> float:
        """As `loop_area` gives it."""
        return loop_area(self.commands, self.displacements)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """What was done with one actuator."""

    actuator: Actuator  # The one
    recording: Recording
    loop: Loop  # At `LOOP_RATE`, of another experiment, which begins at rest too


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All experiments."""

    benches: tuple[Bench, ...]
    loops: tuple[Loop, ...]
    elastic_loops: tuple[Loop, ...]


def carry_out(
    seed: int, duration: float = DURATION, *, jobs: int = 1, finished: Callable[[int, int], None] | None = None
) -> Study:
    """Do all experiments."""
    wished = specification()
    tasks: list[tuple[Any, ...]] = [(_record, actuator, duration) for actuator in fleet(seed)]
    tasks += [(loops_of, plant, RATES) for plant in (wished, wished.without_effects())]
    done = run_jobs(
        _do, tasks, workers=jobs, finished=None if finished is None else lambda count: finished(count, len(tasks))
    )
    return Study(benches=tuple(done[:-2]), loops=done[-2], elastic_loops=done[-1])


def cycle(rate: float, sample_time: float) -> Experiment:
    """Triangles over the thesis' range of commands: two that make the film forget its start, and one to look at.
    `rate` of the last one, Hz.
    """
    pieces = [triangles(sample_time, lower=1.1, upper=3.75, rates=(r,), cycles=1) for r in (0.1, 0.1, rate)]
    starts = np.cumsum([0, *(p.size for p in pieces[:-1])]) * sample_time
    return Experiment(
        recordings=tuple(
            Recording.from_arrays(piece, np.zeros_like(piece), sample_time, start=start)
            for piece, start in zip(pieces, starts, strict=True)
        )
    )


def loops_of(plant: Plant, rates: tuple[float, ...]) -> tuple[Loop, ...]:
    """Loops of a plant, as they are without the sensor. `rates` hz."""
    found = []
    for rate in rates:
        experiment = cycle(rate, plant.rig.sample_time)
        readings = plant.simulate(experiment).require().outputs[-1][0]
        found.append(Loop(rate=rate, commands=experiment.recordings[-1].inputs[0], displacements=readings))
    return tuple(found)


def _record(actuator: Actuator, duration: float) -> Bench:
    recording = actuator.record(actuator.excitation(duration)).recordings[0]
    last = actuator.record(cycle(LOOP_RATE, recording.sample_time)).recordings[-1]
    loop = Loop(rate=LOOP_RATE, commands=last.inputs[0], displacements=last.outputs[0])
    return Bench(actuator=actuator, recording=recording, loop=loop)


def _do(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)
