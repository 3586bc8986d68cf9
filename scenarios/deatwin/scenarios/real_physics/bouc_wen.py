"""The Bouc-Wen benchmark, which is simulated: a mass on a hysteretic spring, taken as a linear oscillator.

Two periods of a multisine are diagnosed; the two official test signals, a multisine and a swept sine, judge. The
recordings are public (Noël & Schoukens 2016).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deatwin.plant import (
    Builder,
    Effect,
    Experiment,
    Hysteresis,
    Parameter,
    Place,
    Plant,
    ReadingTime,
    Rig,
    Scale,
    Sizes,
)
from deatwin.plant.arrays import Array
from deatwin.plant.effects.smooth import smooth_magnitude
from deatwin.scenarios.real_physics.silverbox import derivatives, held
from deatwin.studies.missing_physics import Case, HeldOut, Law, experiment_of, tell
from deatwin.studies.public.records import BOUC_WEN_PERIOD as PERIOD
from deatwin.studies.public.records import BOUC_WEN_RATE as RATE
from deatwin.studies.public.records import bouc_wen, bouc_wen_signals
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
BAND = 200.0  # Hz, up to which the recording is differentiated: the input ends at 150


@dataclass(frozen=True, kw_only=True)
class LinearOscillator(Rig):
    """A mass between a linear spring and a damper."""

    sample_time: float = 1 / RATE
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "bouc-wen"
    input_name: ClassVar[str] = "force"
    input_unit: ClassVar[str] = "N"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"
    model_share: ClassVar[float] = 0.02
    sizes: ClassVar[Sizes] = Sizes(motion=1e-3, force=50.0, period=1 / 35, command=50.0, command_unit="N", body="mass")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="mass", value=2.0, unit="kg", lower=0.1, upper=100.0, scale=log),
            Parameter(name="damping", value=10.0, unit="N s/m", lower=0.1, upper=1e4, scale=log),
            Parameter(name="stiffness", value=9e4, unit="N/m", lower=1e3, upper=1e7, scale=log),
        )

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=1e-3))
        velocity = build.watch("velocity", build.state("velocity", scale=0.2))
        drive = build.place(Place.DRIVE, "command", build.command)
        damper = -build.parameter("damping") * velocity
        force = build.place(Place.BALL, "force", damper)
        build.watch("missing", force - damper)
        build.rate(position, velocity)
        build.rate(velocity, drive - build.parameter("stiffness") * position + force, mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", position)

    def effects(self) -> tuple[Effect, ...]:
        return (*(e for e in super().effects() if e.name != BoucWen.name), BoucWen())


@dataclass(frozen=True, kw_only=True)
class BoucWen(Hysteresis):
    """Bouc and Wen's spring, F = -F_h z, x_h dz/dt = v - |v| z + kappa v |z|, whose force may grow for ever."""

    force: float = 20.0  # F_h in N
    distance: float = 1e-3  # x_h in m
    hardening: float = 0.0  # kappa

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="force", value=self.force, unit="N", lower=0.0, upper=1e3),
            Parameter(name="distance", value=self.distance, unit="m", lower=1e-5, upper=0.1, scale=Scale.LOGARITHMIC),
            Parameter(name="hardening", value=self.hardening, unit="1", lower=-5.0, upper=5.0),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        memory = build.state("hysteresis_memory", scale=1.0, start=0.0)
        velocity = build.signal("velocity")
        speed, strain = (smooth_magnitude(x, 1e-6) for x in (velocity, memory))
        change = velocity - speed * memory + self.own("hardening", build) * velocity * strain
        build.rate(memory, change, mass=self.own("distance", build))
        return signal - self.own("force", build) * memory


def run(setting: Setting) -> Mapping[str, Any]:
    """Diagnose the training multisine, and run free over the test signals."""
    return tell(setting, "boucwen_benchmark_h5", case)


def case(folder: Path) -> Case:
    """The recordings and the plant."""
    data = bouc_wen(folder)
    force, motion = bouc_wen_signals(data.files[0], "multisine", 4 * PERIOD)
    (tested, moved), (swept, followed) = (bouc_wen_signals(data.files[1], name) for name in ("multisine", "sinesweep"))
    # The test multisine is one period of a steady state: two periods before it lead in.
    multisine = HeldOut(
        name="The test multisine",
        experiment=_experiment(held(np.tile(tested, 3)), np.tile(moved, 3)),
        first=2 * PERIOD,
        black_box=data,
    )
    sweep = HeldOut(name="The test sweep", experiment=_experiment(held(swept), followed))
    return Case(
        name="bouc-wen",
        title="Bouc-Wen benchmark",
        documented=("hysteresis",),
        plant=Plant(rig=LinearOscillator()),
        fitted=(_experiment(held(force)[: 2 * PERIOD], motion[: 2 * PERIOD]),),
        held_out=(multisine, sweep),
        unit="µm",
        scale=1e-6,
        files=data.files,
        law=lambda amended: _law(amended, motion, force),
        notes=WORDS.texts("bouc_wen.notes"),
    )


def _experiment(force: Array, motion: Array) -> Experiment:
    return experiment_of(LinearOscillator(), force, motion)


def _law(amended: Plant, motion: Array, force: Array) -> Law:
    """The force that acceleration, velocity and position of a later period of the training record need."""
    mass, damping, stiffness = (amended.parameters[n].value for n in ("mass", "damping", "stiffness"))
    later = slice(3 * PERIOD, 4 * PERIOD)
    x, v, a = derivatives(motion[later], 1 / RATE, BAND)
    run = amended.simulate(_experiment(held(force), motion)).require().watched[0]
    return Law(
        state="displacement (m)",
        force="force on the mass (N)",
        measured=(x, mass * a + damping * v + stiffness * x - force[later]),
        modelled=(run["displacement"][later], run["missing"][later]),
        caption=WORDS.text("bouc_wen.law", band=BAND),
    )
