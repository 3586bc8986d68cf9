"""The physics that is documented of three benchmarks, written down whole and calibrated: nothing is to be found."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deatwin.ident import run_jobs
from deatwin.ident.greybox import Calibration, calibrate
from deatwin.plant import Builder, Experiment, Parameter, Place, Plant, ReadingTime, Rig, Scale, Sizes
from deatwin.plant.arrays import Array
from deatwin.plant.effects.smooth import smooth_sign, soft_excess
from deatwin.plant.words import spaced
from deatwin.scenarios.real_physics import bouc_wen, cascaded_tanks
from deatwin.scenarios.real_physics.cascaded_tanks import Tanks
from deatwin.studies.missing_physics import HeldOut
from deatwin.studies.provenance import hashes
from deatwin.studies.public.records import EMPS_FILES, emps_averaged
from deatwin.studies.public.sources import data_folder
from deatwin.studies.report.drawing import Drawing, draw, draw_runs
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish, reached
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("published.toml").read_text(encoding="utf-8"))
PUBLISHED: list[dict[str, str]] = _FILE["published"]
"""Errors on test parts, each with its model; sources and places that recur have a name."""


def said(test: str) -> str:
    """Return the results of others on a test part, in one line."""
    return ", ".join(f"{one['error']} ({one['model']})" for one in PUBLISHED if one["test"] == test)


def sources() -> Table:
    """Return all figures with their sources."""
    own = [[one["test"], one["error"], one["model"]] for one in PUBLISHED]
    places = [[_FILE["source"].get(one["source"], one["source"]), _FILE["read"][one["read"]]] for one in PUBLISHED]
    return WORDS.table("sources", [[*cells, *place] for cells, place in zip(own, places, strict=True)])


AVERAGED = 5
"""Samples of 1 ms that make one of EMPS: the mean voltage keeps the impulse, and friction needs no finer ones."""
MOTOR = 35.150651882485469  # N/V, as the benchmark's file has it
STARTS = 3  # Fits of which two must agree


@dataclass(frozen=True, kw_only=True)
class BrimmedTanks(Tanks):
    """Two tanks that overflow, whose outlets follow a power of the level; the sensor ends at 10 V."""

    kind: ClassVar[str] = "brimmed-tanks"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        kept = {p.name: p for p in super().parameters if p.name not in ("area_ratio", "upper_start")}
        return (
            *kept.values(),
            Parameter(name="upper_start", value=5.0, unit="V", lower=0.0, upper=30.0),
            Parameter(name="brim", value=9.8, unit="V", lower=3.0, upper=40.0),
            Parameter(name="lower_brim", value=10.0, unit="V", lower=8.0, upper=15.0),
            Parameter(name="caught", value=0.3, unit="1", lower=0.0, upper=1.0),
            Parameter(name="upper_power", value=0.5, unit="1", lower=0.2, upper=1.5),
            Parameter(name="lower_power", value=0.5, unit="1", lower=0.2, upper=1.5),
        )

    def write(self, build: Builder) -> Any:
        p = build.parameter
        upper = build.watch("upper_level", build.state("upper", scale=5.0, start=p("upper_start")))
        lower = build.watch("displacement", build.state("lower", scale=5.0, start=p("lower_start")))
        above = soft_excess(build.place(Place.DRIVE, "command", build.command) - p("threshold"), 0.02)
        between, out = (
            p(f"{name}_outlet") * (level**2 + 0.01**2) ** (p(f"{name}_power") / 2)
            for name, level in (("upper", upper), ("lower", lower))
        )
        spilt, lost = (soft_excess(x - p(name), 0.05) for x, name in ((upper, "brim"), (lower, "lower_brim")))
        build.rate(upper, p("pump") * above - between - spilt)
        build.rate(lower, between + p("caught") * spilt - out - lost)
        return build.place(Place.SENSOR, "reading", lower - soft_excess(lower - 10.0, 0.01))


@dataclass(frozen=True, kw_only=True)
class OpenCarriage(Rig):
    """A carriage with dry and viscous friction and a force offset, driven by the motor's voltage."""

    sample_time: float = 1e-3 * AVERAGED
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD
    uneven: bool = False  # True if viscous friction may differ between the directions

    kind: ClassVar[str] = "open-carriage"
    input_name: ClassVar[str] = "voltage"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "m"
    sizes: ClassVar[Sizes] = Sizes(
        motion=0.1, force=50.0, period=0.02, command=1.0, command_unit="V", reading=20e-6, body="carriage"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        named = (
            Parameter(name="mass", value=95.0, unit="kg", lower=10.0, upper=1e3, scale=Scale.LOGARITHMIC),
            Parameter(name="viscosity", value=200.0, unit="N s/m", lower=0.0, upper=1e4),
            Parameter(name="offset", value=0.0, unit="N", lower=-100.0, upper=100.0),
            Parameter(name="dry", value=20.0, unit="N", lower=0.0, upper=100.0),
        )
        difference = Parameter(name="viscous_difference", value=0.0, unit="N s/m", lower=-200.0, upper=200.0)
        return (*named, difference) if self.uneven else named

    def write(self, build: Builder) -> Any:
        p = build.parameter
        position = build.watch("displacement", build.state("position", scale=0.1))
        velocity = build.watch("velocity", build.state("velocity", scale=0.1))
        way = smooth_sign(velocity, 5e-4)
        viscosity = p("viscosity") + (p("viscous_difference") * way if self.uneven else 0.0)
        drive = MOTOR * build.place(Place.DRIVE, "command", build.command) - p("offset")
        force = build.place(Place.BALL, "force", -viscosity * velocity - p("dry") * way)
        build.rate(position, velocity)
        build.rate(velocity, drive + force, mass=p("mass"))
        return build.place(Place.SENSOR, "reading", position)


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A plant, what it is fitted to, and what judges it."""

    name: str
    plant: Plant
    fitted: tuple[Experiment, ...]
    held_out: HeldOut
    unit: str
    scale: float
    goal: float  # In that unit
    test: str  # Name of the test part among the standard tasks


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A calibrated plant, and its free run over the test part."""

    task: Task
    fit: Calibration
    seconds: float  # Time to calibrate
    readings: Array  # shape (n,): The free run where it counts, SI

    @property
    def error(self) -> float:
        """Rms error over the test part, in the unit shown."""
        return float(np.sqrt(np.mean((self.task.held_out.measured - self.readings) ** 2))) / self.task.scale


def run(setting: Setting) -> Mapping[str, Any]:
    """Calibrate every plant on its training part, and run it free over the test part."""
    found = calibrated(setting.data, setting.jobs)
    folders = [data_folder(setting.data, name) for name in ("cascaded_tanks", "emps", "boucwen_benchmark_h5")]
    read = [file for folder in folders for file in sorted(folder.iterdir()) if file.suffix in (".csv", ".mat", ".h5")]
    record = setting.record(hashes(read))
    rows = [within(f"{j.task.name}: free-run error on the test part", j.error, j.task.goal, j.task.unit) for j in found]
    page = StoryPage(
        title="grey-boxes",
        sentence=f"The documented physics of three benchmarks, calibrated on the training parts: {reached(rows)} goals "
        "reached on the test parts; " + "; ".join(f"{j.task.name} {j.error:.3g} {j.task.unit}" for j in found) + ".",
        rows=rows,
        figures=[_drawn(number, one) for number, one in enumerate(found, start=1)],
        notes=[Note(title="How it was judged", paragraphs=WORDS.texts("grey_boxes.notes"))],
        tables=[_table(found), *(_parameters(one) for one in found), sources()],
    )
    return finish(setting.folder, record, page, errors={one.task.name: one.error for one in found})


def within(name: str, error: float, goal: float, unit: str, told: str = "") -> Measure:
    """Compare an error with its goal; `told` is what is reached in words, by default the error."""
    return Measure(name, f"at most {goal:g} {unit} rms", told or f"{error:.3g} {unit}", bool(error <= goal))


def calibrated(data: Path | None, jobs: int, sets: Collection[str] | None = None) -> list[Judged]:
    """Return the plants of some of the data sets, or of all, calibrated."""
    makers = {"Cascaded tanks": _tanks, "EMPS": _emps, "Bouc-Wen": _bouc_wen}
    plants = [(tasks,) for name, make in makers.items() if sets is None or name in sets for tasks in make(data)]
    return [one for judged in run_jobs(_judged, plants, workers=jobs) for one in judged]


def _judged(tasks: tuple[Task, ...]) -> list[Judged]:
    """Calibrate the plant that tasks share; they differ in the test part."""
    begun = time.perf_counter()
    fit = calibrate(tasks[0].plant, tasks[0].fitted, starts=STARTS)
    seconds = time.perf_counter() - begun
    runs = [task.held_out.readings(fit.plant) for task in tasks]
    return [Judged(task=task, fit=fit, seconds=seconds, readings=run) for task, run in zip(tasks, runs, strict=True)]


def _tanks(data: Path | None) -> Iterator[tuple[Task, ...]]:
    case = cascaded_tanks.case(data_folder(data, "cascaded_tanks"))
    about: dict[str, Any] = {"fitted": case.fitted, "held_out": case.held_out[0], "unit": "V", "scale": 1.0}
    plant, test = Plant(rig=BrimmedTanks()), "Cascaded tanks, validation"
    yield (Task(name="Cascaded tanks", plant=plant, test=test, goal=0.19, **about),)


def _emps(data: Path | None) -> Iterator[tuple[Task, ...]]:
    folder = data_folder(data, "emps")
    fitted, judged = (Experiment(recordings=(emps_averaged(folder / name, AVERAGED),)) for name in EMPS_FILES)
    about: dict[str, Any] = {"unit": "mm", "scale": 1e-3, "goal": 5.4, "fitted": (fitted,)}
    held_out = HeldOut(name="The validation record, with force pulses", experiment=judged)
    for name, uneven in (("EMPS, four parameters", False), ("EMPS, uneven friction", True)):
        plant = Plant(rig=OpenCarriage(uneven=uneven))
        yield (Task(name=name, plant=plant, held_out=held_out, test="EMPS, pulses", **about),)


def _bouc_wen(data: Path | None) -> Iterator[tuple[Task, ...]]:
    case = bouc_wen.case(data_folder(data, "boucwen_benchmark_h5"))
    plant = Plant(rig=bouc_wen.LinearOscillator(), effects=(bouc_wen.BoucWen(),))
    about: dict[str, Any] = {"plant": plant, "fitted": case.fitted, "unit": "µm", "scale": 1e-6, "goal": 15.0}
    yield tuple(
        Task(name=f"Bouc-Wen, {name}", test=f"Bouc-Wen, {name}", held_out=held, **about)
        for name, held in zip(("multisine", "sweep"), case.held_out, strict=True)
    )


def _drawn(number: int, one: Judged) -> Drawing:
    held_out, scale = one.task.held_out, one.task.scale
    runs = {"free run of the calibrated plant": one.readings / scale}
    with draw((7.4, 3.8)) as figure:
        draw_runs(figure, held_out.timepts, held_out.measured / scale, runs, one.task.unit)
        return WORDS.drawing(figure, "test", None, f"test_{number}", name=one.task.name)


def _table(found: list[Judged]) -> Table:
    rows = []
    for one in found:
        errors = [f"{error:.3g} {one.task.unit}" for error in (one.fit.rms / one.task.scale, one.error)]
        rows.append([one.task.name, str(len(one.fit.names)), *errors, said(one.task.test)])
    return WORDS.table("grey_boxes", rows)


def _parameters(one: Judged) -> Table:
    rows = []
    for name in one.fit.names:
        (low, high), p = one.fit.interval(name), one.fit.plant.parameters[name]
        known = f"{low:.3g} to {high:.3g}" if one.fit.is_determined(name) else "undetermined"
        rows.append([spaced(name), f"{p.value:.4g} {'' if p.unit == '1' else p.unit}".rstrip(), known])
    return WORDS.table("parameters", rows, name=one.task.name)
