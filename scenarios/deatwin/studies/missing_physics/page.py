"""Run a scenario of missing physics: diagnose, judge on held-out recordings, write the page."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any

from deatwin.studies.missing_physics.case import (
    Case,
    Trial,
    amended_plant,
    diagnosed,
    error_table,
    judged,
    measures,
    tried_table,
)
from deatwin.studies.missing_physics.figures import drawings
from deatwin.studies.parallel import between
from deatwin.studies.provenance import hashes
from deatwin.studies.public.sources import data_folder, origins
from deatwin.studies.report.story import Note, StoryPage, finish
from deatwin.studies.stories import Setting


def tell(setting: Setting, source: str, case_of: Callable[[Path], Case]) -> dict[str, Any]:
    """Read the public recordings `source`, diagnose, judge on the held-out ones, and write the page."""
    case = case_of(data_folder(setting.data, source))
    record = setting.record(hashes(case.files))
    diagnosis = diagnosed(setting, case, "diagnosis", between(setting.progress, 0.0, 0.7))
    setting.progress(0.7, "the held-out recordings")
    trials = judged(case, diagnosis, setting.jobs)
    setting.progress(0.95, "drawing")
    rows = measures(case, diagnosis, trials)
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
        held_out={t.held_out.name: _plain(t) for t in trials},
    )


def _plain(trial: Trial) -> dict[str, Any]:
    black_boxes = {o.method: o.free_run if isfinite(o.free_run) else None for o in trial.black_boxes}
    return {"base": trial.base_error, "amended": trial.amended_error, "black_boxes": black_boxes}


def _said(case: Case, trial: Trial) -> str:
    base, amended = trial.base_error / case.scale, trial.amended_error / case.scale
    best = trial.best_black_box
    beside = "" if best is None else f" (best NARX model: {best.free_run / case.scale:.3g} {case.unit} rms)"
    return (
        f"On the held-out recording {trial.held_out.name}, the free-run error in {case.loop} is {base:.3g} {case.unit} rms "
        f"without and {amended:.3g} {case.unit} rms with the added effects{beside}."
    )
