"""The concealed apparatus: a film that the rig file misdescribes, its mechanisms, its history, and a noisy sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from deatwin.plant.integrator.rosenbrock import integrate
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.diaphragm import BALLS, Diaphragm
from deatwin.scenarios.concealed_physics.generator.mechanism import Drive, Mechanism, Reading

FILM_ERROR = 0.2  # By how much a film's parameter may lie beside the published one, as a share
FITTED = ("shear_modulus", "stretch_limit", "branch_modulus", "branch_time", "permittivity", "damping")
ELEMENTS = 5  # Elements of the fine film under its electrode: another mesh than the one that gives a plant's own error
BALL_TOLD, READ_AT_START = 0.6, 0.15
"""Shares of rig files that tell how the film sits on the ball, and of rigs read at the start of a hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rigging:
    """A rig as described to the diagnosis, and as it really is."""

    nominal: Plant  # As the rig file describes it
    actual: Plant  # The film that is there, on a fine mesh
    reduced: Plant  # The same film on the diagnosis' mesh
    before: tuple[tuple[float, float], ...]  # History: commands in V, each with how long it was held in s


def drawn_rig(rng: np.random.Generator, *, usual: bool = False) -> Rigging:
    """Draw a rig; usual ones have the same ball contact and reading time, so that they share compiled equations."""
    ball = str(rng.choice(BALLS))
    told = bool(rng.random() < BALL_TOLD)
    if usual:
        ball, told = Diaphragm.ball, True
    rig = Diaphragm(
        material="VHB 4905",
        thickness=round(0.5e-3 * rng.uniform(0.9, 1.1), 6),
        prestretch=round(rng.uniform(3.3, 3.8), 2),
        frame_radius=round(40e-3 * rng.uniform(0.9, 1.1), 4),
        electrode_radius=round(17.5e-3 * rng.uniform(0.9, 1.1), 4),
        contact_radius=round(rng.uniform(1.5e-3, 3.5e-3), 4),
        mass=round(rng.uniform(2e-3, 4e-3), 5),
        start_ramp=round(rng.uniform(1.0, 3.0), 1),
        start_hold=round(rng.uniform(2.0, 4.0), 1),
        ball=ball if told else Diaphragm.ball,
        ball_is_known=told,
    )
    nominal = Plant(rig=rig)
    values = {name: nominal.parameters[name].value * (1 + FILM_ERROR * rng.uniform(-1, 1)) for name in FITTED}
    at_start = rng.random() < READ_AT_START and not usual
    there = replace(rig, ball=ball, reading=ReadingTime.START_OF_HOLD if at_start else ReadingTime.END_OF_HOLD)
    fine = replace(there, resolution="fine", elements=ELEMENTS)
    before = ((rng.uniform(0.5, 2.0), rng.uniform(5.0, 30.0)), (0.0, rng.uniform(60.0, 600.0)))
    return Rigging(
        nominal=nominal, actual=Plant(rig=fine, values=values), reduced=Plant(rig=there, values=values), before=before
    )


def with_added_mass(plant: Plant, added: float) -> Plant:
    """Return the plant of a diaphragm with a heavier ball."""
    rig = plant.rig
    if not isinstance(rig, Diaphragm):
        raise TypeError(f"a {type(rig).__name__} has no ball; the study's rigs are diaphragms")
    return plant.with_rig(replace(rig, mass=rig.mass + added))


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """White, first-order coloured noise and rounding: r = round_q(y + w + c), c_k = a c_{k-1} + sqrt(1 - a^2) n_k."""

    rms: float
    coloured: float  # Share of the variance of w + c that c has
    pole: float  # a, between 0 and 1
    step: float  # q, m

    @classmethod
    def drawn(cls, rng: np.random.Generator, rms: float) -> Self:
        """Draw noise of a given size."""
        step = rms * rng.uniform(0.1, 1.0)
        return cls(rms=rms, coloured=rng.uniform(0.1, 0.5), pole=rng.uniform(0.3, 0.85), step=step)

    def added(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Add noise and round. Shapes: `values` (n,); returns (n,)."""
        from scipy.signal import lfilter

        random = np.sqrt(self.rms**2 - self.step**2 / 12)
        white, pushes = rng.standard_normal((2, values.size))
        start = [self.pole * pushes[0]]  # stationary from the first sample on
        rest, _ = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], pushes[1:], zi=start)
        coloured = np.concatenate([pushes[:1], rest])
        noisy = values + random * (np.sqrt(1 - self.coloured) * white + np.sqrt(self.coloured) * coloured)
        return np.round(noisy / self.step) * self.step


@dataclass(frozen=True, kw_only=True, eq=False)
class Apparatus:
    """A film with concealed mechanisms, a history and a sensor: it takes commands and gives readings."""

    plant: Plant  # The film that is there, without mechanisms
    mechanisms: tuple[Mechanism, ...]
    before: tuple[tuple[float, float], ...]  # History: commands in V, each with how long it was held in s
    noise: SensorNoise
    seed: int

    def readings(self, experiment: Experiment, run: int = 0) -> tuple[np.ndarray, ...]:
        """Read each recording without the sensor's noise. Shapes: returns (n,)."""
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

    def noisy(self, experiment: Experiment, readings: Sequence[np.ndarray], rng: np.random.Generator) -> Experiment:
        """Add the sensor's noise to readings; an advised record has commands only and learns here what is read."""
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
