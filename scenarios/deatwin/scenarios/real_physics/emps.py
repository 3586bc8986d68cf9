"""EMPS: a carriage on a ball screw, recorded under its controller, taken without dry friction.

The first 13 s of the estimation record are diagnosed; its remainder, and the validation record with its pulses, judge.
The recordings are public (Janot, Gautier & Brunot 2019).
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
    Parameter,
    Place,
    Plant,
    ReadingTime,
    Recording,
    Rig,
    Scale,
    Sizes,
    catalogue,
)
from deatwin.studies.missing_physics import Case, HeldOut, Law, experiment_of, tell
from deatwin.studies.public.records import EMPS_FILES, emps_deviation, matlab_vectors, require_samples
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
FITTED = 13_000  # Samples: two strokes out and back
SMOOTH = 25.0  # Hz, up to which the recording is differentiated


@dataclass(frozen=True, kw_only=True)
class ControlledCarriage(Rig):
    """A carriage with viscous friction and a force offset, driven by a motor under a cascade of two gains."""

    sample_time: float = 1e-3
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD
    model_error: float = 2.5e-6
    """The controller samples, and is taken as continuous: half a millisecond of 2 m/s² is 6 µm at its position gain."""

    kind: ClassVar[str] = "emps"
    input_name: ClassVar[str] = "reference"
    input_unit: ClassVar[str] = "m"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "m"
    sizes: ClassVar[Sizes] = Sizes(
        motion=0.1, force=50.0, period=0.02, command=0.1, command_unit="m", reading=20e-6, body="carriage"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log, source = Scale.LOGARITHMIC, "the recordings' file"
        return (
            Parameter(name="mass", value=80.0, unit="kg", lower=10.0, upper=1e3, scale=log),
            Parameter(name="viscosity", value=100.0, unit="N s/m", lower=0.0, upper=1e4),
            Parameter(name="offset", value=0.0, unit="N", lower=-100.0, upper=100.0),
            Parameter(name="position_gain", value=160.18, unit="1/s", lower=1.0, upper=1e3, known=True, source=source),
            Parameter(
                name="velocity_gain", value=243.45, unit="V s/m", lower=1.0, upper=1e3, known=True, source=source
            ),
            Parameter(name="motor", value=35.15, unit="N/V", lower=1.0, upper=1e3, known=True, source=source),
        )

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=0.1))
        velocity = build.watch("velocity", build.state("velocity", scale=0.1))
        behind = build.place(Place.DRIVE, "command", build.command) - position
        wanted = build.parameter("position_gain") * behind - velocity
        voltage = build.watch("voltage", build.parameter("velocity_gain") * wanted + build.channel("pulse_V", 0.0))
        drive = build.parameter("motor") * voltage + build.parameter("offset")
        viscous = -build.parameter("viscosity") * velocity
        force = build.place(Place.BALL, "force", viscous)
        build.watch("missing", force - viscous)
        build.rate(position, velocity)
        build.rate(velocity, drive + force, mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", position)

    def effects(self) -> tuple[Effect, ...]:
        """The catalogue without machines' effects: a reference has no play, and uneven friction is in the offset."""
        return tuple(self.sizes.of(effect) for effect in catalogue())


def run(setting: Setting) -> Mapping[str, Any]:
    """Diagnose the opening of the estimation record, and run free over the rest and over the validation record."""
    return tell(setting, "emps", case)


def case(folder: Path) -> Case:
    """The recordings and the plant."""
    files = tuple(folder / name for name in EMPS_FILES)
    estimation, validation = (_recording(file) for file in files)
    opening, rest = estimation.section(0, FITTED), estimation.section(FITTED, estimation.n_samples)
    return Case(
        name="emps",
        title="EMPS",
        documented=("coulomb_friction",),
        plant=Plant(rig=ControlledCarriage()),
        fitted=(Experiment(recordings=(opening,)),),
        held_out=(
            HeldOut(
                name="The validation record, with force pulses",
                experiment=Experiment(recordings=(validation,)),
                black_box=emps_deviation(opening, validation),
                follows=True,
            ),
            HeldOut(
                name="The rest of the estimation record",
                experiment=Experiment(recordings=(estimation,)),
                first=FITTED,
                black_box=emps_deviation(opening, rest),
                follows=True,
            ),
        ),
        unit="µm",
        scale=1e-6,
        files=files,
        loop="closed loop",
        law=lambda amended: _law(amended, validation, files[1]),
        notes=WORDS.texts("emps.notes", seconds=FITTED / 1000),
    )


def _recording(file: Path) -> Recording:
    data = matlab_vectors(file, ("qg", "qm"), optional=("pulses_N",))
    reference, position = data["qg"], data["qm"]
    require_samples(file, position.size, FITTED + 1)
    extras = {"pulse_V": data["pulses_N"]} if "pulses_N" in data else {}
    middle = np.append((reference[1:] + reference[:-1]) / 2, reference[-1])
    rig = ControlledCarriage()
    return experiment_of(rig, middle, position, extras=extras, provenance={"file": file.name}).recordings[0]


def _law(amended: Plant, judged: Recording, file: Path) -> Law:
    """Force that is left of the recorded motor voltage, which holds the pulses, after inertia, viscosity and offset."""
    from scipy.signal import butter, filtfilt

    step, p = judged.sample_time, {name: q.value for name, q in amended.parameters.items()}
    volts, position = matlab_vectors(file, ("vir",))["vir"], judged.outputs[0]
    low = butter(2, 2 * SMOOTH * step)
    position, volts = (filtfilt(*low, x) for x in (position, volts))
    velocity = np.gradient(position, step)
    force = p["mass"] * np.gradient(velocity, step) + p["viscosity"] * velocity - p["motor"] * volts - p["offset"]
    inside = slice(200, -200)
    signals = amended.simulate(Experiment(recordings=(judged,))).require().watched[0]
    return Law(
        state="velocity (m/s)",
        force="force on the carriage (N)",
        measured=(velocity[inside], force[inside]),
        modelled=(signals["velocity"], signals["missing"]),
        caption=WORDS.text("emps.law", band=SMOOTH),
    )
