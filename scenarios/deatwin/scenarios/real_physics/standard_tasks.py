"""The field's standard tasks, one after the other under the rules of the benchmarks' own site, in one table.

Models learn from the official training part; their free runs start from the first samples of a test part, which do not
count, and are judged over the rest of it. The tanks begin both records at the same levels, as their authors say: a state
space begins its run over the test part where it began the training part.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.nss import NonlinearStateSpace
from deatwin.ident.parallel import jobs_as_they_end
from deatwin.scenarios.real_physics.grey_boxes import Judged, calibrated
from deatwin.scenarios.real_physics.published import said, sources
from deatwin.scenarios.real_physics.task_parts import CUBIC, STATES, Task, standard_tasks
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.public.black_boxes import GROWN, LINEAR, Outcome, free, learned
from deatwin.studies.public.records import DataSet
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish, reached
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

Array = NDArray[np.float64]
WORDS = Words(__package__)
PLANT, UNEVEN = "calibrated plant", "calibrated plant, uneven friction"
CLAIMED = (GROWN, STATES, CUBIC, PLANT, UNEVEN)
"""Recipes that stand for deatwin; the others stand beside them."""
LONGEST = {("silverbox", STATES): 60.0, ("bouc_wen", STATES): 50.0, ("silverbox", GROWN): 10.0}
USUAL, QUICK = 1.0, 0.2
"""How long models take, compared with each other: for the progress, and for the order; linear ones are quick."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the table."""

    task: str
    model: str
    size: str
    error: float  # In the unit
    unit: str
    seconds: float
    goal: float
    said: str = ""  # Why there is no error


def run(setting: Setting) -> Mapping[str, Any]:
    """Learn, run free, and write the table; Ctrl-C ends with the models that were learned until then."""
    tasks, left_out = standard_tasks(setting.data, setting.tasks)
    record = setting.record(hashes(path for task in tasks for path in task.data.files))
    jobs = _ordered([(method, task.data) for task in tasks for method in task.methods], setting.jobs)
    done: list[Outcome] = []
    plants: list[Judged] = []
    try:
        _learn(jobs, setting, done)
        setting.progress(0.95, "plants")
        plants += calibrated(setting.data, setting.jobs, [task.data.title for task in tasks])
    except KeyboardInterrupt:
        if done:
            ended = f"Interrupted after {len(done)} of {len(jobs)} models. "
            _written(setting, record, tasks, done, plants, left_out, ended)
        raise
    return _written(setting, record, tasks, done, plants, left_out)


def _ordered(jobs: Sequence[tuple[str, DataSet]], workers: int) -> list[tuple[str, DataSet]]:
    """Return the jobs as they begin, the shortest first; one of several workers begins with the longest."""
    rising = sorted(jobs, key=_length)
    if workers == 1:
        return rising
    quick = [job for job in rising if _length(job) <= QUICK]
    usual = [job for job in rising if QUICK < _length(job) <= USUAL]
    long = rising[len(quick) + len(usual) :]
    return [*quick, *long[-1:], *usual, *long[-2::-1]]


def _length(job: tuple[str, DataSet]) -> float:
    method, data = job
    return LONGEST.get((data.name, method), QUICK if method == LINEAR else USUAL)


def _learn(jobs: list[tuple[str, DataSet]], setting: Setting, done: list[Outcome]) -> None:
    """Learn all models, and tell how far that is by how long each takes."""
    left = set(range(len(jobs)))

    def tell() -> None:
        share = 1.0 - sum(_length(jobs[i]) for i in left) / sum(map(_length, jobs))
        still = [f", still {jobs[i][1].title}: {jobs[i][0]}" for i in sorted(left)[:1]]
        setting.progress(0.95 * share, f"{len(jobs) - len(left)} of {len(jobs)} models{''.join(still)}")

    tell()
    quick = sum(_length(job) <= QUICK for job in jobs)
    for begin, end, workers in ((0, quick, 1), (quick, len(jobs), setting.jobs)):  # workers take seconds to start
        # Closing ends the workers at once.
        with closing(jobs_as_they_end(learned, jobs[begin:end], workers=workers)) as running:
            for number, outcome in running:
                left.discard(begin + number)
                tell()  # which raises where a fit was interrupted: what it found until then is no result
                done.append(outcome)


def _written(
    setting: Setting,
    record: RunRecord,
    tasks: Sequence[Task],
    done: list[Outcome],
    plants: list[Judged],
    left_out: Sequence[str],
    ended: str = "",
) -> Mapping[str, Any]:
    """Judge the models, and write the page."""
    outcomes = {(o.data, o.method): o for o in done}
    wanted = [(task, outcomes.get((task.data.name, method))) for task in tasks for method in task.methods]
    rows = [row for task, outcome in wanted if outcome for row in _judged(task, outcome)]
    rows += [_of_plant(one) for one in plants]
    measures = [_measure(row) for row in rows if row.model in CLAIMED]
    notes = [Note(title="Rules", paragraphs=WORDS.texts("standard_tasks.notes"))]
    notes += [Note(title="Left out", paragraphs=left_out)] if left_out else []
    page = StoryPage(
        title="standard-tasks",
        sentence=f"{ended}The standard tasks, free runs over the official test parts: {reached(measures)} goals reached.",
        rows=measures,
        figures=[] if ended else [_drawn(rows)],  # whoever interrupts waits for an answer
        notes=notes,
        tables=[_table(rows), sources()],
    )
    return finish(setting.folder, record, page, errors=[_plain(row) for row in rows], notes=left_out)


def _judged(task: Task, outcome: Outcome) -> list[Row]:
    """Return the lines of one model: its free run over each test part."""
    rows = []
    for test in task.tests:
        error, said = np.nan, outcome.failure
        if outcome.model is not None:
            ran = free(outcome.model, test.recording, test.shown, outcome.first_state if task.same_start else None)
            left = test.recording.outputs[0, test.shown :] - ran.outputs[0, -test.recording.n_samples :][test.shown :]
            said = "" if ran.status.ok else "diverges"
            error = float(np.sqrt(np.mean(left**2))) / task.data.scale if ran.status.ok else np.nan
        rows.append(
            Row(
                task=f"{task.data.title}, {test.name}",
                model=outcome.method,
                size=_size(outcome),
                error=error,
                unit=task.data.unit,
                seconds=outcome.seconds,
                goal=test.goal,
                said=said,
            )
        )
    return rows


def _size(outcome: Outcome) -> str:
    """Say how large a model is."""
    if outcome.model is None:
        return "–"
    if isinstance(outcome.model, NonlinearStateSpace):
        return f"{outcome.model.n_states} states, {outcome.terms} weights"
    return f"{outcome.terms} terms"


def _of_plant(one: Judged) -> Row:
    """Return the line of a calibrated plant; its run counts from the first sample on."""
    return Row(
        task=one.task.test,
        model=UNEVEN if "uneven" in one.task.name else PLANT,
        size=f"{len(one.fit.names)} parameters",
        error=one.error,
        unit=one.task.unit,
        seconds=one.seconds,
        goal=one.task.goal,
    )


def _measure(row: Row) -> Measure:
    """Hold an error against the goal."""
    told = row.said or f"{row.error:.3g} {row.unit}, {row.size}"
    return Measure(
        f"{row.task}: {row.model}", f"at most {row.goal:g} {row.unit} rms", told, bool(row.error <= row.goal)
    )


def _table(rows: list[Row]) -> Table:
    return Table.of(
        "Root mean square errors of free runs over the official test parts",
        sorted(rows, key=lambda row: row.task),
        {
            "task": lambda row: row.task,
            "model": lambda row: row.model,
            "size": lambda row: row.size,
            "error": lambda row: row.said or f"{row.error:.3g} {row.unit}",
            "training time (s)": lambda row: f"{row.seconds:.1f}",
            "published": lambda row: said(row.task),
        },
    )


def _drawn(rows: list[Row]) -> Drawing:
    """Draw the errors over the goals, one line of dots for each test part."""
    tasks, models = (sorted({getattr(row, name) for row in rows}) for name in ("task", "model"))
    columns: dict[str, Array] = {"test_number": np.arange(1.0, len(tasks) + 1)}
    looks = [(colour, marker) for marker in "osD" for colour in (Hue.AFTER, Hue.BEFORE, Hue.MARK, Hue.MEASURED)]
    with draw((9.6, 4.6)) as figure:
        axes = figure.subplots()
        for model, (colour, marker) in zip(models, looks, strict=False):
            found = {row.task: row.error / row.goal for row in rows if row.model == model}
            values = np.array([found.get(task, np.nan) for task in tasks])
            axes.plot(values, range(len(tasks)), marker, color=colour, markersize=4, label=model)
            columns["_".join(re.findall(r"\w+", model)).lower()] = values
        axes.axvline(1.0, color=Hue.INK, linestyle=":")
        axes.set(xscale="log", xlabel="error / goal", xlim=(0.03, 100.0))
        axes.set_yticks(range(len(tasks)), tasks)
        axes.invert_yaxis()
        legend_above(figure, axes, 3)
        return Drawing.of(
            figure,
            "errors",
            "Errors of free runs over the goals",
            "Left of the dotted line a goal is reached; runs whose error is more than a hundred times the goal are left "
            "out. Tests are numbered from above in the data.",
            columns,
        )


def _plain(row: Row) -> dict[str, Any]:
    error = row.error if np.isfinite(row.error) else None
    return {"task": row.task, "model": row.model, "size": row.size, "error": error, "unit": row.unit}
