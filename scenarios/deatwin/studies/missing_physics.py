"""A plant without some documented physics: diagnosed, then judged on recordings that were held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.mismatch import Diagnosis
from deatwin.ident.parallel import run_jobs
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import envelope
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.records import finite
from deatwin.plant.rigs.base import Rig
from deatwin.plant.words import spaced
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder
from deatwin.studies.parallel import between
from deatwin.studies.provenance import hashes
from deatwin.studies.public.black_boxes import GROWN, LINEAR, REFINED, Outcome, attempt
from deatwin.studies.public.records import DataSet
from deatwin.studies.public.sources import data_folder, origins
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting
from deatwin.studies.voice import Progress

WORDS = Words(__package__)
BLACK_BOXES = (LINEAR, REFINED, GROWN)  # Black boxes that are compared with the plant; the last two are NARX models


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """A held-out recording, on which nothing is fitted or chosen."""

    name: str
    experiment: Experiment  # Begins at rest, or with samples that lead in
    first: int = 0  # First sample of its last record that counts; earlier ones lead in
    black_box: DataSet | None = None  # Data for black boxes: their training data, and this recording as a test
    follows: bool = False  # True if the readings follow the input

    def readings(self, plant: Plant) -> Array:
        """Return a plant's free run at the counted samples. Shapes: returns (n,)."""
        return plant.simulate(self.experiment).require().outputs[-1][0, self.first :]

    @property
    def measured(self) -> Array:
        """Readings at the samples that count, shape (n,), SI."""
        return self.experiment.recordings[-1].outputs[0, self.first :]

    @property
    def level(self) -> Array:
        """Level subtracted from readings in figures, shape (n,), SI: the input if readings follow it, else 0."""
        command = self.experiment.recordings[-1].inputs[0, self.first :]
        return command if self.follows else np.zeros_like(command)

    @property
    def timepts(self) -> Array:
        """Clock times of the samples that count, shape (n,), s."""
        return self.experiment.recordings[-1].timepts[self.first :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """The missing physics as a function of the state that it depends on."""

    state: str  # Label of the state, with unit
    force: str  # Label of the force, with unit
    measured: tuple[Array, Array]  # State and force, shapes (n,)
    modelled: tuple[Array, Array]  # State and force of the amended plant, shapes (m,)
    caption: str  # Origin of the measured force


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A recording with a plant that lacks documented physics."""

    name: str
    title: str
    documented: tuple[str, ...]  # Effects that count as right answers
    plant: Plant  # Plant without these effects
    fitted: tuple[Experiment, ...]
    held_out: tuple[HeldOut, ...]  # The official test recording first, if there is one
    unit: str  # Unit in which errors are shown
    scale: float  # Size of that unit, SI
    files: tuple[Path, ...]  # Files from which the recordings were read
    notes: tuple[str, ...]  # Notes on the recordings and the plant
    law: Callable[[Plant], Law]  # Takes the amended plant, returns the `Law`
    loop: str = "open loop"


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Free runs of all models over a held-out recording."""

    held_out: HeldOut
    base: Array  # shape (n,): Readings of the calibrated base plant, SI
    amended: Array  # shape (n,): Readings of the amended plant, SI
    black_boxes: tuple[Outcome, ...]  # Results of black boxes trained on the same samples

    @property
    def base_error(self) -> float:
        """Rms of measured minus base plant, SI."""
        return float(np.sqrt(np.mean((self.held_out.measured - self.base) ** 2)))

    @property
    def amended_error(self) -> float:
        """Rms of measured minus amended plant, SI."""
        return float(np.sqrt(np.mean((self.held_out.measured - self.amended) ** 2)))

    @property
    def best_black_box(self) -> Outcome | None:
        """The NARX model with the smallest error on the held-out recording; choosing it there favours it."""
        sound = [o for o in self.black_boxes if o.method != LINEAR and np.isfinite(o.free_run)]
        return min(sound, key=lambda o: o.free_run) if sound else None


def experiment_of(rig: Rig, inputs: Array, outputs: Array, sample_time: float | None = None, **more: Any) -> Experiment:
    """Make an experiment of one recording, with the rig's signal names. Shapes: `inputs, outputs` (n,)."""
    record = Recording.from_arrays(
        inputs,
        outputs,
        sample_time or rig.sample_time,
        input_names=(rig.input_name,),
        output_names=(rig.output_name,),
        input_units=(rig.input_unit,),
        output_units=(rig.output_unit,),
        **more,
    )
    return Experiment(recordings=(record,))


def diagnosed(setting: Setting, case: Case, name: str, progress: Progress) -> Diagnosis:
    """Diagnose the fitted recordings; results go to a folder inside that of the scenario."""
    task = DiagnosisTask(
        plant=case.plant,
        experiments=case.fitted,
        files=case.files,
        command=setting.command,
        jobs=setting.jobs,
        seed=setting.seed,
    )
    with ResultFolder(setting.folder.path / name) as own:
        diagnosis = task.run(own, progress)
    setting.folder.written.extend(f"{name}/{written}" for written in own.written)
    return diagnosis


def amended_plant(diagnosis: Diagnosis) -> Plant | None:
    """Return the plant with the named effects; None if none was named."""
    return diagnosis.model.plant if diagnosis.causes and diagnosis.model is not None else None


def judged(case: Case, diagnosis: Diagnosis, jobs: int = 1) -> tuple[Trial, ...]:
    """Simulate plants, and black boxes trained on the same samples, over the held-out recordings."""
    known, model = diagnosis.base_model, diagnosis.model
    if known is None or model is None:
        raise ModelError("a diagnosis without its evidence cannot be judged")
    base = calibrate(known.plant, case.fitted, starts=1).plant
    tasks = [
        (method, held.black_box)
        for held in case.held_out
        if held.black_box is not None
        for method in reversed(BLACK_BOXES)
    ]
    outcomes = run_jobs(attempt, tasks, workers=jobs)
    trials = []
    for held in case.held_out:
        own = tuple(o for o, (_, data) in zip(outcomes, tasks, strict=True) if data is held.black_box)
        readings = held.readings(base), held.readings(model.plant)
        trials.append(Trial(held_out=held, base=readings[0], amended=readings[1], black_boxes=own[::-1]))
    return tuple(trials)


def measures(case: Case, diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Measure]:
    """Compare a diagnosis and its free runs with their goals."""
    causes, verdict = [cause.effect for cause in diagnosis.causes], diagnosis.verdict.value
    right = bool(causes) and set(causes) <= set(case.documented) and verdict == "named"
    told = {"documented": " or ".join(case.documented), "causes": ", ".join(causes) or "no cause"}
    rows = [WORDS.measure("named", right, verdict=verdict, **told)]
    for trial in trials:
        base, after = trial.base_error / case.scale, trial.amended_error / case.scale
        name = trial.held_out.name
        rows.append(WORDS.measure("error", after < base, name=name, base=base, after=after, unit=case.unit))
    return rows


def error_table(case: Case, trials: Sequence[Trial]) -> Table:
    """Return the table of free-run errors on the held-out recordings."""
    rows = []
    for trial in trials:
        errors = {"calibrated base plant": trial.base_error, "amended plant": trial.amended_error}
        shown = {name: f"{error / case.scale:.4g}" for name, error in errors.items()}
        for o in trial.black_boxes:
            shown[f"{o.method}, {o.terms} parameters"] = o.failure or f"{o.free_run / case.scale:.4g}"
        rows += [[trial.held_out.name, *row] for row in shown.items()]
    return WORDS.table("errors", rows, loop=case.loop, unit=case.unit)


def tried_table(case: Case, diagnosis: Diagnosis) -> Table:
    """Return the table of the effects that the diagnosis tried, with their remaining errors."""
    rows = []
    for c in sorted(diagnosis.candidates, key=lambda c: c.fitted):
        errors = [f"{error / case.scale:.4g}" for error in (c.fitted, c.unseen)]
        rows.append([spaced(" and ".join(c.effects)) or "none", *errors])
    return WORDS.table("tried", rows, unit=case.unit)


ZOOM = 300  # Samples in the magnified part, which are drawn one by one
DRAWN = 4000  # Most points of a long line, drawn as the extremes of its pieces


def held_out(case: Case, trial: Trial) -> Drawing:
    """Draw the recording with both plants: in full, and where the base plant fails most."""
    held, rig = trial.held_out, case.plant.rig
    time, scale = held.timepts, case.scale
    measured, base, amended = ((y - held.level) / scale for y in (held.measured, trial.base, trial.amended))
    peak = int(np.argmax(np.abs(measured - base)))
    first = int(np.clip(peak - ZOOM // 2, 0, max(measured.size - ZOOM, 0)))
    near = slice(first, first + ZOOM)
    label = f"{rig.output_name}{f' − {rig.input_name}' if held.follows else ''} ({case.unit})"
    with draw((9.6, 5.6)) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=(2, 3))
        top.plot(*envelope(time, measured, DRAWN // 2), color=Hue.MEASURED, linewidth=0.5)
        top.axvspan(time[near][0], time[near][-1], color=Hue.MARK, alpha=0.3, linewidth=0)
        top.set(ylabel=label)
        bottom.plot(time[near], base[near], color=Hue.BEFORE, label="calibrated base plant")
        bottom.plot(time[near], amended[near], color=Hue.AFTER, linewidth=1.6, label="amended plant")
        bottom.plot(time[near], measured[near], ".", color=Hue.INK, markersize=3.0, label="recording")
        bottom.set(ylabel=label, xlabel="time (s)")
        legend_above(figure, bottom, 3)
        columns = {"time_s": time, "recording": measured, "base": base, "amended": amended}
        shown = {name: values[near] for name, values in columns.items()}
        return WORDS.drawing(figure, "held_out", shown, title=case.title, name=held.name)


def residuals(case: Case, trial: Trial) -> Drawing:
    """Draw the residuals of both plants over time and over frequency."""
    from scipy.signal import welch

    time, rate = trial.held_out.timepts, 1 / case.plant.rig.sample_time
    measured = trial.held_out.measured / case.scale
    columns: dict[str, Array] = {}
    with draw((9.6, 5.2)) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=(3, 2))
        for name, readings, colour in (("base", trial.base, Hue.BEFORE), ("amended", trial.amended, Hue.AFTER)):
            left = measured - readings / case.scale
            frequencies, density = welch(left, rate, nperseg=min(2048, left.size // 4))
            columns |= {"frequency_Hz": frequencies[1:], name: np.sqrt(density)[1:]}
            label = f"{'calibrated base' if name == 'base' else name} plant: {np.sqrt(np.mean(left**2)):.3g} rms"
            top.plot(*envelope(time, left, DRAWN // 2), color=colour, linewidth=0.8, label=label)
            bottom.loglog(frequencies[1:], np.sqrt(density)[1:], color=colour)
        top.set(ylabel=f"measured − simulated ({case.unit})", xlabel="time (s)")
        bottom.set(ylabel=f"density ({case.unit}/√Hz)", xlabel="frequency (Hz)")
        legend_above(figure, top, 2)
        return WORDS.drawing(figure, "residuals", columns, title=case.title, name=trial.held_out.name)


def law(case: Case, found: Law) -> Drawing:
    """Draw the missing force over the quantity on which it depends."""
    with draw((6.4, 4.2)) as figure:
        axes = figure.add_subplot()
        if found.measured[0].size:
            step = max(found.measured[0].size // DRAWN, 1)
            axes.plot(*(v[::step] for v in found.measured), ".", color=Hue.MEASURED, markersize=1.5, label="recording")
        step = max(found.modelled[0].size // DRAWN, 1)
        axes.plot(*(v[::step] for v in found.modelled), ".", color=Hue.AFTER, markersize=2.0, label="amended plant")
        axes.set(xlabel=found.state, ylabel=found.force)
        legend_above(figure, axes, 2)
        columns = {"state": found.modelled[0], "missing": found.modelled[1]}
        return WORDS.drawing(figure, "law", columns, title=case.title, caption=found.caption)


def drawings(case: Case, trial: Trial, amended: Plant | None) -> list[Drawing]:
    """Draw all figures; the law only if an effect was named."""
    made = [held_out(case, trial), residuals(case, trial)]
    return made if amended is None else [*made, law(case, case.law(amended))]


def tell(setting: Setting, source: str, case_of: Callable[[Path], Case]) -> dict[str, Any]:
    """Read the public recordings `source`, diagnose, judge on the held-out ones, and write the page."""
    case = case_of(data_folder(setting.data, source))
    record = setting.record(hashes(case.files))
    diagnosis = diagnosed(setting, case, "diagnosis", between(setting.progress, 0.0, 0.7))
    setting.progress(0.7, "the held-out recordings")
    trials = judged(case, diagnosis, setting.jobs)
    setting.progress(0.95, "drawing")
    rows = measures(case, diagnosis, trials)
    held_out = {}
    for trial in trials:
        boxes = {o.method: o.free_run for o in trial.black_boxes}
        held_out[trial.held_out.name] = {"base": trial.base_error, "amended": trial.amended_error, "black_boxes": boxes}
    page = StoryPage(
        title=case.name,
        sentence=f"{diagnosis.sentence} {_said(case, trials[0])}",
        rows=rows,
        figures=drawings(case, trials[0], amended_plant(diagnosis)),
        notes=[
            Note(title="The recordings and the plant", paragraphs=case.notes),
            Note(title="The diagnosis", paragraphs=["Step by step: diagnosis/report.html.", *diagnosis.warnings]),
        ],
        tables=[
            error_table(case, trials),
            tried_table(case, diagnosis),
            origins(setting.data, {source: case.files}),
        ],
    )
    return finish(
        setting.folder,
        record,
        page,
        verdict=diagnosis.verdict.value,
        causes=[cause.effect for cause in diagnosis.causes],
        set=list(diagnosis.names),
        right=rows[0].passed,
        held_out=finite(held_out),
    )


def _said(case: Case, trial: Trial) -> str:
    base, amended = trial.base_error / case.scale, trial.amended_error / case.scale
    best = trial.best_black_box
    beside = "" if best is None else f" (best NARX model: {best.free_run / case.scale:.3g} {case.unit} rms)"
    told = {"loop": case.loop, "unit": case.unit, "beside": beside}
    return WORDS.text("sentence", name=trial.held_out.name, base=base, amended=amended, **told)
