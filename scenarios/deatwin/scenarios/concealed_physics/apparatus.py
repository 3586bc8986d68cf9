"""The concealed apparatus: a fine film with its mechanisms, a pre-history, and a sensor, which takes commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.scenarios.concealed_physics.mechanisms import Drive, Mechanism, Reading
from deatwin.scenarios.concealed_physics.noise import SensorNoise
from deatwin.scenarios.concealed_physics.rosenbrock import integrate


@dataclass(frozen=True, kw_only=True, eq=False)
class Apparatus:
    """What stands on the table."""

    plant: Plant  # The film that is there, without mechanisms
    mechanisms: tuple[Mechanism, ...]  # What is concealed in it
    before: tuple[tuple[float, float], ...]
    noise: SensorNoise
    seed: int

    def with_mechanisms(self, *mechanisms: Mechanism) -> Apparatus:
        """The same apparatus with other mechanisms."""
        return replace(self, mechanisms=mechanisms)

    def readings(self, experiment: Experiment, run: int = 0) -> tuple[np.ndarray, ...]:
        """Readings without the sensor's noise. Shapes: returns (n,)."""
        timeline = self.plant.timeline(experiment)
        step = timeline.sample_time
        before = np.array([seconds for _, seconds in self.before])
        times = np.concatenate(
            [timeline.start - np.cumsum(before[::-1])[::-1], timeline.start + step * np.arange(timeline.commands.size)]
        )
        wished = np.concatenate([[command for command, _ in self.before], timeline.commands])
        rows = [timeline.start + step * (r + 1) for r in timeline.readings]
        reads = np.concatenate([[timeline.start], *rows])
        drive, rng = Drive(times=times, commands=wished), np.random.default_rng([self.seed, run])
        for mechanism in self.mechanisms:
            drive = mechanism.commanded(drive, rng)
        values = self._integrated(drive, reads)
        commands = np.concatenate([wished[before.size :][:1], *(r.inputs[0] for r in experiment.recordings)])
        for mechanism in self.mechanisms:
            values = mechanism.read(Reading(times=reads, values=values, commands=commands), rng)
        ends = 1 + np.cumsum([r.n_samples for r in experiment.recordings])
        return tuple(np.split(values[1:] - values[0], ends[:-1] - 1))

    def record(self, experiment: Experiment, rng: np.random.Generator, run: int = 0) -> Experiment:
        """Recordings as the experimenter gets them."""
        return self.noisy(experiment, self.readings(experiment, run), rng)

    def noisy(self, experiment: Experiment, readings: Sequence[np.ndarray], rng: np.random.Generator) -> Experiment:
        """Readings with the sensor's noise, as recordings."""
        # An advised record has commands only: it learns here what is read.
        rig, pairs = self.plant.rig, zip(experiment.recordings, readings, strict=True)
        return Experiment(
            recordings=tuple(
                replace(
                    record,
                    outputs=self.noise.added(reading, rng)[None],
                    output_names=(rig.output_name,),
                    output_units=(rig.output_unit,),
                )
                for record, reading in pairs
            )
        )

    def _integrated(self, drive: Drive, reads: np.ndarray) -> np.ndarray:
        plant = self.plant.with_effects(*(e for m in self.mechanisms for e in m.effects))
        equations = plant.equations
        inputs = equations.inputs(drive.commands, drive.rest_command, drive.times, drive.channels)
        return integrate(
            equations, plant.free_values, drive.times, inputs, reads, rest_command=drive.rest_command
        ).outputs
