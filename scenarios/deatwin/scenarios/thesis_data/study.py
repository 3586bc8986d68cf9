"""The experiments of the story: six recordings, loops of each actuator, and loops of the specification."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.curves import loop_area
from deatwin.plant import Actuator, Experiment, Plant, Recording, fleet, specification
from deatwin.plant.excitation import triangles
from deatwin.studies.parallel import call, run_told
from deatwin.studies.voice import Progress

LOOP_RATE = 0.01  # Rate of the actuators' loops, Hz
RATES = (0.1, 0.01, 0.001)  # Rates of the loops of the specification, Hz


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """One cycle of a triangle."""

    rate: float  # Hz
    commands: NDArray[np.float64]  # shape (n,): V
    displacements: NDArray[np.float64]  # shape (n,): m

    @property
    def area(self) -> float:
        """Area of the loop over the rectangle around it."""
        return loop_area(self.commands, self.displacements)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """An actuator, its recording and its loop."""

    actuator: Actuator
    recording: Recording
    loop: Loop  # At `LOOP_RATE`, from another experiment that begins at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Results of all experiments."""

    benches: tuple[Bench, ...]
    loops: tuple[Loop, ...]
    elastic_loops: tuple[Loop, ...]


def carry_out(seed: int, *, jobs: int, progress: Progress) -> Study:
    """Run all experiments."""
    wished = specification()
    tasks: list[tuple[Any, ...]] = [(_record, actuator) for actuator in fleet(seed)]
    tasks += [(loops_of, plant, RATES) for plant in (wished, wished.without_effects())]
    *benches, loops, elastic = run_told(call, tasks, jobs, progress, "recording six actuators")
    return Study(benches=tuple(benches), loops=loops, elastic_loops=elastic)


def cycle(rate: float, sample_time: float) -> Experiment:
    """Triangles over the thesis' range of commands: two that let the film forget its start, and one at `rate`, Hz."""
    pieces = [triangles(sample_time, lower=1.1, upper=3.75, rates=(r,), cycles=1) for r in (0.1, 0.1, rate)]
    starts = np.cumsum([0, *(p.size for p in pieces[:-1])]) * sample_time
    return Experiment(
        recordings=tuple(
            Recording.from_arrays(piece, np.zeros_like(piece), sample_time, start=start)
            for piece, start in zip(pieces, starts, strict=True)
        )
    )


def loops_of(plant: Plant, rates: tuple[float, ...]) -> tuple[Loop, ...]:
    """Loops of a plant without the sensor, at `rates`, Hz."""
    found = []
    for rate in rates:
        experiment = cycle(rate, plant.rig.sample_time)
        readings = plant.simulate(experiment).require().outputs[-1][0]
        found.append(Loop(rate=rate, commands=experiment.recordings[-1].inputs[0], displacements=readings))
    return tuple(found)


def _record(actuator: Actuator) -> Bench:
    recording = actuator.record().recordings[0]
    last = actuator.record(cycle(LOOP_RATE, recording.sample_time)).recordings[-1]
    loop = Loop(rate=LOOP_RATE, commands=last.inputs[0], displacements=last.outputs[0])
    return Bench(actuator=actuator, recording=recording, loop=loop)
