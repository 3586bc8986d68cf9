"""The Silverbox: a circuit that oscillates like a mass on a hardening spring, taken as a linear oscillator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deatwin.plant import Builder, Experiment, Parameter, Place, Plant, ReadingTime, Rig, Scale, Sizes
from deatwin.plant.arrays import Array
from deatwin.studies.missing_physics import Case, HeldOut, Law, experiment_of, tell
from deatwin.studies.public.records import ARROW_HEAD, SILVERBOX_RATE, silverbox_table
from deatwin.studies.public.records import silverbox as black_box_data
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting


def held(values: Array) -> Array:
    """Return held values (n,) that act on a plant like the band-limited input with the samples `values` (n,)."""
    frequencies = np.fft.rfftfreq(values.size)
    spectrum = np.fft.rfft(values) * np.exp(1j * np.pi * frequencies) / np.sinc(frequencies)
    return np.fft.irfft(spectrum, values.size)


def derivatives(values: Array, sample_time: float, band: float) -> tuple[Array, Array, Array]:
    """A signal (n,) and its first two derivatives by the Fourier transform, up to `band`, Hz."""
    frequencies = np.fft.rfftfreq(values.size, sample_time)
    spectrum, omega = np.fft.rfft(values) * (frequencies <= band), 2j * np.pi * frequencies
    first, second, third = (np.fft.irfft(spectrum * omega**order, values.size) for order in range(3))
    return first, second, third


WORDS = Words(__package__)
FITTED = slice(40_540, 57_900)  # Two realisations of the multisine, each after some hundred samples of rest
BAND = 250.0  # Hz, up to which the recording is differentiated: the input ends at 200


@dataclass(frozen=True, kw_only=True)
class LinearOscillator(Rig):
    """A mass between a spring and a damper, in volts: what the circuit is without its cubic term."""

    sample_time: float = 1 / SILVERBOX_RATE
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "silverbox"
    input_name: ClassVar[str] = "input"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "output"
    output_unit: ClassVar[str] = "V"
    model_share: ClassVar[float] = 0.02
    sizes: ClassVar[Sizes] = Sizes(
        motion=0.1, force=2e4, period=1 / 70, command=0.1, motion_unit="V", force_unit="V/s2", body="mass"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="gain", value=1e5, unit="1/s2", lower=1e3, upper=1e7, scale=log),
            Parameter(name="damping", value=50.0, unit="1/s", lower=1.0, upper=1e4, scale=log),
            Parameter(name="stiffness", value=2e5, unit="1/s2", lower=1e4, upper=1e7, scale=log),
            Parameter(name="zero", value=0.0, unit="V", lower=-0.1, upper=0.1),
        )

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=0.1))
        velocity = build.watch("velocity", build.state("velocity", scale=40.0))
        damper = -build.parameter("damping") * velocity
        force = build.place(Place.BALL, "force", damper)
        build.watch("missing", force - damper)
        drive = build.parameter("gain") * build.place(Place.DRIVE, "command", build.command)
        build.rate(position, velocity)
        build.rate(velocity, drive - build.parameter("stiffness") * position + force)
        return build.place(Place.SENSOR, "reading", position + build.parameter("zero"))


def run(setting: Setting) -> Mapping[str, Any]:
    """Diagnose the multisine, and run free over the arrow-head."""
    return tell(setting, "silverbox", case)


def case(folder: Path) -> Case:
    """The recordings and the plant."""
    data = black_box_data(folder)
    table, _ = silverbox_table(folder)
    command, output = held(table[:, 0]), table[:, 1]
    rig = LinearOscillator()

    def section(part: slice) -> Experiment:
        return experiment_of(rig, command[part], output[part], provenance={"file": data.files[0].name})

    judged = HeldOut(name="The arrow-head", experiment=section(ARROW_HEAD), black_box=data)
    return Case(
        name="silverbox",
        title="Silverbox",
        documented=("cubic_stiffness",),
        plant=Plant(rig=rig),
        fitted=(section(FITTED),),
        held_out=(judged,),
        unit="mV",
        scale=1e-3,
        files=data.files,
        law=lambda amended: _law(amended, table, judged),
        notes=WORDS.texts("silverbox.notes", first=FITTED.start, last=FITTED.stop),
    )


def _law(amended: Plant, table: Array, judged: HeldOut) -> Law:
    """The force that the recorded position, velocity and acceleration leave to explain."""
    k, c, b, zero = (amended.parameters[n].value for n in ("stiffness", "damping", "gain", "zero"))
    x, v, a = (d[ARROW_HEAD] for d in derivatives(table[:, 1] - zero, amended.rig.sample_time, BAND))
    signals = amended.simulate(judged.experiment).require().watched[0]
    return Law(
        state="displacement (V)",
        force="force (V/s²)",
        measured=(x, a + c * v + k * x - b * table[ARROW_HEAD, 0]),
        modelled=(signals["displacement"], signals["missing"]),
        caption=WORDS.text("silverbox.law", band=BAND),
    )
