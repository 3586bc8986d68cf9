"""What the stories share: a plant without the documented physics, diagnosed, then judged on recordings held out."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.mismatch import Diagnosis
from deatwin.ident.parallel import run_jobs
from deatwin.plant.errors import ModelError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.scenarios.real_data.methods import GROWN, LINEAR, REFINED, Outcome, attempt
from deatwin.scenarios.real_data.records import DataSet
from deatwin.scenarios.real_data.sources import origins
from deatwin.scenarios.real_physics import figures
from deatwin.scenarios.real_physics.accounts import error_table, measures, tried_table
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.story import Note, StoryPage, write_story
from deatwin.studies.stories import Setting
from deatwin.studies.voice import Progress

Array = NDArray[np.float64]
FOLDERS = {"cascaded-tanks": "cascaded_tanks", "bouc-wen": "boucwen_benchmark_h5"}
"""Of the recordings, where the story is called otherwise."""
RIVALS = (LINEAR, REFINED, GROWN)
"""Methods of the story ``real-data`` that stand beside the plant; NARX are the last two."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """A recording on which nothing is fitted or chosen."""

    name: str
    experiment: Experiment  # From rest, or through what goes before
    first: int = 0  # Sample of its last record from which on it counts; those before lead in
    rival: DataSet | None = None
    follows: bool = False

    def readings(self, plant: Plant) -> Array:
        """A plant's free run where it counts. Shapes: returns (n,)."""
        return plant.simulate(self.experiment).require().outputs[-1][0, self.first :]

    @property
    def measured(self) -> Array:
        """Readings where it counts, shape (n,), SI."""
        return self.experiment.recordings[-1].outputs[0, self.first :]

    @property
    def level(self) -> Array:
        """What a figure takes off all readings where it counts, shape (n,), SI: the input where they follow it."""
        command = self.experiment.recordings[-1].inputs[0, self.first :]
        return command if self.follows else np.zeros_like(command)

    @property
    def timepts(self) -> Array:
        """Their clock times, shape (n,), s."""
        return self.experiment.recordings[-1].timepts[self.first :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """What the missing physics does, over what it depends on."""

    state: str  # Labels with units
    force: str
    measured: tuple[Array, Array]
    modelled: tuple[Array, Array]  # shape (m,): The same of the amended plant
    caption: str  # How the measured one was made


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A recording and a plant from which its documented physics is left out."""

    name: str
    title: str
    documented: tuple[str, ...]  # Effects that would be right answers
    plant: Plant  # Without them
    fitted: tuple[Experiment, ...]
    held_out: tuple[HeldOut, ...]  # The official test recording first, where there is one
    unit: str
    scale: float
    files: tuple[Path, ...]  # Read from
    notes: tuple[str, ...]  # What was done with the recordings, and what of the plant needs saying
    law: Callable[[Plant], Law]  # Takes the amended plant, returns the `Law`
    loop: str = "open loop"


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Free runs over a held-out recording."""

    held_out: HeldOut  # The recording
    base: Array  # shape (n,): Readings of the calibrated base plant and of the amended one, SI
    amended: Array
    rivals: tuple[Outcome, ...]  # Of black boxes that learned from the same samples

    @property
    def base_error(self) -> float:
        """Rms of measured minus base plant, SI."""
        return float(np.sqrt(np.mean((self.held_out.measured - self.base) ** 2)))

    @property
    def amended_error(self) -> float:
        """Rms of measured minus amended plant, SI."""
        return float(np.sqrt(np.mean((self.held_out.measured - self.amended) ** 2)))

    @property
    def best_rival(self) -> Outcome | None:
        """The NARX with the least error here: chosen on the held-out recording, in its favour."""
        sound = [o for o in self.rivals if o.method != LINEAR and np.isfinite(o.free_run)]
        return min(sound, key=lambda o: o.free_run) if sound else None


def tell(setting: Setting, case: Case) -> Mapping[str, Any]:
    """Diagnose, judge on the held-out recordings, and write the page."""
    record = RunRecord(command=setting.command, inputs=hashes(case.files), seed=setting.seed, jobs=setting.jobs)
    diagnosis = diagnosed(setting, case, "diagnosis", lambda share, text: setting.progress(0.7 * share, text))
    setting.progress(0.7, "the held-out recordings")
    trials = judged(case, diagnosis, setting.jobs)
    setting.progress(0.95, "drawing")
    return _written(setting, case, diagnosis, trials, record)


def diagnosed(setting: Setting, case: Case, name: str, progress: Progress) -> Diagnosis:
    """Diagnose the fitted recordings, into a folder below that of the story."""
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


def judged(case: Case, diagnosis: Diagnosis, jobs: int = 1) -> tuple[Trial, ...]:
    """Run the plants, and black boxes that learned from the same samples, over the held-out recordings."""
    known, model = diagnosis.base_model, diagnosis.model
    if known is None or model is None:
        raise ModelError("a diagnosis without its models cannot be judged")
    base = calibrate(known.plant, case.fitted, starts=1).plant
    amended = model.plant
    tasks = [(method, held.rival) for held in case.held_out if held.rival is not None for method in reversed(RIVALS)]
    outcomes = run_jobs(attempt, tasks, workers=jobs)
    trials = []
    for held in case.held_out:
        own = tuple(o for o, (_, data) in zip(outcomes, tasks, strict=True) if data is held.rival)
        trials.append(Trial(held_out=held, base=held.readings(base), amended=held.readings(amended), rivals=own[::-1]))
    return tuple(trials)


def _written(
    setting: Setting, case: Case, diagnosis: Diagnosis, trials: Sequence[Trial], record: RunRecord
) -> Mapping[str, Any]:
    rows = measures(case, diagnosis, trials)
    sentence = f"{diagnosis.sentence} {_said(case, trials[0])}"
    made = [figures.held_out(case, trials[0]), figures.residuals(case, trials[0])]
    if diagnosis.causes and diagnosis.model is not None:
        made.append(figures.law(case, case.law(diagnosis.model.plant)))
    for drawing, columns in made:
        setting.folder.csv(drawing.data, columns)
    source = FOLDERS.get(case.name, case.name)
    page = StoryPage(
        title=case.name,
        sentence=sentence,
        rows=rows,
        figures=[drawing for drawing, _ in made],
        notes=[
            Note(title="The recordings and the plant", paragraphs=case.notes),
            Note(title="The diagnosis", paragraphs=["Step by step: diagnosis/report.html.", *diagnosis.warnings]),
        ],
        tables=[error_table(case, trials), tried_table(case, diagnosis), origins(setting.data, {source: case.files})],
    )
    write_story(setting.folder, page, record)
    result = {
        "sentence": sentence,
        "verdict": diagnosis.verdict.value,
        "causes": [cause.effect for cause in diagnosis.causes],
        "set": list(diagnosis.names),
        "right": page.rows[0].passed,
        "measures": [asdict(row) for row in rows],
        "held_out": {t.held_out.name: _plain(t) for t in trials},
    }
    setting.folder.text(f"{case.name}.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _plain(trial: Trial) -> dict[str, Any]:
    rivals = {o.method: o.free_run if np.isfinite(o.free_run) else None for o in trial.rivals}
    return {"base": trial.base_error, "amended": trial.amended_error, "black_boxes": rivals}


def _said(case: Case, trial: Trial) -> str:
    base, amended = trial.base_error / case.scale, trial.amended_error / case.scale
    best = trial.best_rival
    beside = "" if best is None else f"; the best NARX leaves {best.free_run / case.scale:.3g}"
    return (
        f"{trial.held_out.name}, on which nothing was fitted or chosen: free run in {case.loop} to {base:.3g} "
        f"{case.unit} rms before, {amended:.3g} after{beside}."
    )
