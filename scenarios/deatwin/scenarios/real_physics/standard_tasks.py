"""The field's standard tasks, one after the other under the rules of the benchmarks' own site, in one table.

Models learn from the official training part; their free runs start from the first samples of a test part, which do not
count, and are judged over the rest of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.nss import Cascade, NonlinearStateSpace, Pnlss
from deatwin.ident.nss.basis import monomials
from deatwin.ident.parallel import run_jobs
from deatwin.plant.recording import Recording
from deatwin.scenarios.real_physics import bouc_wen, emps
from deatwin.scenarios.real_physics.grey_boxes import Judged, calibrated
from deatwin.studies.provenance import hashes
from deatwin.studies.public.black_boxes import GROWN, LINEAR, REFINED, Outcome, attempt, free
from deatwin.studies.public.columns import hdf5_vectors, matlab_vectors
from deatwin.studies.public.records import (
    SILVERBOX_RATE,
    Candidates,
    DataSet,
    cascaded_tanks,
    silverbox,
    silverbox_table,
)
from deatwin.studies.public.sources import data_folder
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish, reached
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
METHODS = (LINEAR, REFINED, GROWN)
STATES, CUBIC, CASCADE, PLANT = (
    "nonlinear state space",
    "nonlinear state space, cubic",
    "Hammerstein-Wiener",
    "calibrated plant",
)
CLAIMED = (GROWN, STATES, CUBIC, PLANT)
"""Recipes that stand for deatwin; the others stand beside them."""
SILVERBOX_TRAINING, SILVERBOX_MULTISINE = slice(40_650, 105_712), slice(105_712, 127_400)
ARROW, ARROW_INSIDE = slice(100, 40_575), slice(100, 32_100)
"""The official parts (nonlinear_benchmarks 1.0.0); the arrow-head's shorter one leaves out what lies beyond the training."""
SHOWN = 50
"""First samples of a test part that start a run and do not count; of EMPS 20 of 1 ms, which is one here."""
SILVERBOX_STATES = {
    STATES: Pnlss(states=3, degrees=(), terms=monomials(("x1", "x2", "u"), (2, 3))),
    CUBIC: Pnlss(states=2, degrees=(3,)),
    CASCADE: Cascade(structure="NLN", states=3),
}
"""Of twelve structures with two or three states, the one with the least held-out error whose runs stay bounded at 1.4 times the
training input; and the one whose fits to two halves of the training part agree best there: the arrow-head goes beyond."""
TANKS_STATES = {
    STATES: Pnlss(
        states=2,
        degrees=(2,),
        terms=("tanh(s1,1)", "tanh(s2,1)"),
        directions=2,
        starts=12,
        feedthrough=False,
        held_out=0.3,
    ),
    CASCADE: Cascade(structure="NLN", feedthrough=False, held_out=0.3),
}
"""Of fourteen structures the one that did best in four partings of the training record into learned and judged parts."""
EMPS_STATES = {
    STATES: Pnlss(states=2, degrees=(2, 3, 4, 5), inputs_in_products=False, terms=("tanh(x2,0.1)",), feedthrough=False),
    CASCADE: Cascade(structure="NLN", feedthrough=False),
}
"""Likewise of six. Dry friction is a sign of the second state, about the velocity, smooth at a tenth of its size."""
BOUC_WEN_STATES = {
    STATES: Pnlss(
        states=3,
        degrees=(),
        terms=tuple(f"tanh(s{i},1)" for i in range(1, 9)),
        directions=8,
        starts=2,
        feedthrough=False,
        max_steps=150,
    ),
    CASCADE: Cascade(structure="NLN", states=3, feedthrough=False),
}
EMPS_STEP = 20
"""Samples of 1 ms that make one of a black box."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Test:
    """A test part, with the goal and what others reached, in the task's unit."""

    name: str
    recording: Recording
    goal: float
    published: str
    shown: int = SHOWN


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A training part and the test parts that judge."""

    data: DataSet
    tests: tuple[Test, ...]


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
    published: str
    said: str = ""  # Why there is no error


def run(setting: Setting) -> Mapping[str, Any]:
    """Learn, run free, and write the table."""
    tasks = (_silverbox(setting.data), _tanks(setting.data), _emps(setting.data), _bouc_wen(setting.data))
    record = setting.record(hashes(path for task in tasks for path in task.data.files))
    jobs = [(method, task.data) for task in tasks for method in (*task.data.further, *reversed(METHODS))]
    setting.progress(0.0, f"{len(jobs)} models")
    done = run_jobs(
        attempt,
        jobs,
        workers=setting.jobs,
        finished=lambda count: setting.progress(0.8 * count / len(jobs), f"{count} of {len(jobs)} models"),
    )
    rows = [row for task in tasks for o in done if o.data == task.data.name for row in _judged(task, o)]
    setting.progress(0.8, "plants")
    rows += [_of_plant(one) for one in calibrated(setting.data, setting.jobs)]
    measures = [_measure(row) for row in rows if row.model in CLAIMED]
    page = StoryPage(
        title="standard-tasks",
        sentence=f"The standard tasks, free runs over the official test parts: {reached(measures)} goals reached.",
        rows=measures,
        figures=[],
        notes=[Note(title="Rules", paragraphs=WORDS.texts("standard_tasks.notes"))],
        tables=[_table(rows)],
    )
    return finish(setting.folder, record, page, errors=[_plain(row) for row in rows])


def _silverbox(data: Path | None) -> Task:
    known = silverbox(data_folder(data, "silverbox"))
    table, file = silverbox_table(data_folder(data, "silverbox"))

    def cut(part: slice) -> Recording:
        record = Recording.from_arrays(
            table[part, 0], table[part, 1], 1 / SILVERBOX_RATE, provenance={"file": file.name}
        )
        return replace(record, input_units=("V",), output_units=("V",))

    tests = (
        Test(name="multisine", recording=cut(SILVERBOX_MULTISINE), goal=0.22, published="0.301 (GP-NARX), 0.36"),
        Test(name="arrow-head", recording=cut(ARROW), goal=0.26, published="0.26 (PNLSS)"),
        Test(name="arrow-head, inside", recording=cut(ARROW_INSIDE), goal=0.21, published="0.259 (GP-NARX)"),
    )
    return Task(
        data=replace(known, train=cut(SILVERBOX_TRAINING), test=tests[0].recording, parts=3, further=SILVERBOX_STATES),
        tests=tests,
    )


def _tanks(data: Path | None) -> Task:
    known = cascaded_tanks(data_folder(data, "cascaded_tanks"))
    published = "0.306; 0.396 (GRU)"
    known = replace(known, further=TANKS_STATES)
    return Task(data=known, tests=(Test(name="validation", recording=known.test, goal=0.30, published=published),))


def _emps(data: Path | None) -> Task:
    """Voltage to position in open loop; friction is known to turn with the velocity, and enters by its sign."""
    files = tuple(data_folder(data, "emps") / name for name in emps.FILES)
    train, test = (_averaged(file) for file in files)
    data_set = DataSet(
        name="emps_open",
        title="EMPS",
        train=train,
        test=test,
        unit="mm",
        scale=1e-3,
        files=files,
        candidates=Candidates(
            output_lags=3,
            input_lags=(1, 2, 3),
            degree=1,
            max_terms=10,
            functions=("sign(y(k-1)-y(k-2))", "|y(k-1)-y(k-2)|"),
        ),
        further=EMPS_STATES,
    )
    published = "2.64 (dynoNet), 5.17 (pNARX)"
    return Task(data=data_set, tests=(Test(name="pulses", recording=test, goal=2.6, published=published, shown=1),))


def _averaged(file: Path) -> Recording:
    """Mean voltage of each sample time of the black box, and the position at its beginning."""
    signals = matlab_vectors(file, ("qm", "vir"))
    n = signals["qm"].size // EMPS_STEP * EMPS_STEP
    voltage = signals["vir"][:n].reshape(-1, EMPS_STEP).mean(axis=1)
    record = Recording.from_arrays(
        voltage, signals["qm"][:n:EMPS_STEP], 1e-3 * EMPS_STEP, provenance={"file": file.name}
    )
    return replace(record, input_units=("V",), output_units=("m",))


def _bouc_wen(data: Path | None) -> Task:
    folder = data_folder(data, "boucwen_benchmark_h5")
    known = bouc_wen.case(folder).held_out[0].black_box
    if known is None:
        raise ValueError("the case has a black box")
    published = "18.7 (PNLSS), 45.2 (dynoNet)"
    tests = []
    for name, kept in (("multisine", "multisine"), ("sweep", "sinesweep")):  # as sampled; plants get held values
        force, motion = hdf5_vectors(folder / "test.h5", kept, ("u", "y"))
        record = replace(known.test, inputs=force[None], outputs=motion[None])
        tests.append(Test(name=name, recording=record, goal=15.0, published=published))
    return Task(data=replace(known, unit="µm", scale=1e-6, further=BOUC_WEN_STATES), tests=tuple(tests))


def _judged(task: Task, outcome: Outcome) -> list[Row]:
    """Return the lines of one model: its free run over each test part."""
    rows = []
    for test in task.tests:
        error, said = np.nan, outcome.failure
        if outcome.model is not None:
            ran = free(outcome.model, test.recording, test.shown)
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
                published=test.published,
                said=said,
            )
        )
    return rows


def _size(outcome: Outcome) -> str:
    """Say how large a model is."""
    if isinstance(outcome.model, NonlinearStateSpace):
        return f"{outcome.model.n_states} states, {outcome.terms} weights"
    return f"{outcome.terms} terms"


def _of_plant(one: Judged) -> Row:
    """Return the line of a calibrated plant; its run counts from the first sample on."""
    return Row(
        task=one.task.name,
        model=PLANT,
        size=f"{len(one.fit.names)} parameters",
        error=one.error,
        unit=one.task.unit,
        seconds=one.seconds,
        goal=one.task.goal,
        published=one.task.published,
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
            "time to learn (s)": lambda row: f"{row.seconds:.1f}",
            "published": lambda row: row.published,
        },
    )


def _plain(row: Row) -> dict[str, Any]:
    error = row.error if np.isfinite(row.error) else None
    return {"task": row.task, "model": row.model, "size": row.size, "error": error, "unit": row.unit}
