"""The field's standard tasks, one after the other under the rules of the benchmarks' own site, in one table.

Models learn from the official training part; their free runs start from the first samples of a test part, which do not
count, and are judged over the rest of it. The tanks begin both records at the same levels, as their authors say: a state
space begins its run over the test part where it began the training part.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.nss import Cascade, NonlinearStateSpace, Pnlss
from deatwin.ident.nss.basis import monomials
from deatwin.ident.parallel import jobs_as_they_end
from deatwin.plant.recording import Recording
from deatwin.scenarios.real_physics import bouc_wen, emps
from deatwin.scenarios.real_physics.grey_boxes import Judged, calibrated
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.public.black_boxes import GROWN, LINEAR, REFINED, Outcome, free, learned
from deatwin.studies.public.columns import hdf5_vectors, matlab_vectors
from deatwin.studies.public.peers import SYSIDENTPY, SysIdentPy, like_ours
from deatwin.studies.public.records import (
    SILVERBOX_RATE,
    Candidates,
    DataSet,
    Learner,
    cascaded_tanks,
    silverbox,
    silverbox_table,
)
from deatwin.studies.public.sources import data_folder
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, finish, reached
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

Array = NDArray[np.float64]
WORDS = Words(__package__)
METHODS = (LINEAR, REFINED, GROWN)
STATES, CUBIC, CASCADE, PLANT, UNEVEN = (
    "nonlinear state space",
    "nonlinear state space, cubic",
    "Hammerstein-Wiener",
    "calibrated plant",
    "calibrated plant, uneven friction",
)
CLAIMED = (GROWN, STATES, CUBIC, PLANT, UNEVEN)
"""Recipes that stand for deatwin; the others stand beside them."""
SILVERBOX_TRAINING, SILVERBOX_MULTISINE = slice(40_650, 105_712), slice(105_712, 127_400)
ARROW, ARROW_INSIDE = slice(100, 40_575), slice(100, 32_100)
"""The official parts (nonlinear_benchmarks 1.0.0); the arrow-head's shorter one leaves out what lies beyond the training."""
SHOWN = 50
"""First samples of a test part that start a run and do not count; of the tanks 5, of EMPS 20 of 1 ms, which is one here."""
SILVERBOX_STATES: dict[str, Learner] = {
    STATES: Pnlss(states=3, degrees=(), terms=monomials(("x1", "x2", "u"), (2, 3))),
    CUBIC: Pnlss(states=2, degrees=(3,)),
    CASCADE: Cascade(structure="NLN", states=3),
}
"""Of twelve structures with two or three states, the one with the least held-out error whose runs stay bounded at 1.4 times the
training input; and the one whose fits to two halves of the training part agree best there: the arrow-head goes beyond."""
TANKS_STATES: dict[str, Learner] = {
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
"""Of twenty structures the one that did best in four partings of the training record into learned and judged parts."""
EMPS_STATES: dict[str, Learner] = {
    STATES: Pnlss(
        states=2, degrees=(2, 3, 4, 5), inputs_in_products=False, terms=("tanh(x2,0.05)",), feedthrough=False
    ),
    CASCADE: Cascade(structure="NLN", feedthrough=False),
}
"""Likewise of 29. Dry friction is a sign of the second state, about the velocity, smooth at a twentieth of its size."""
BOUC_WEN_STATES: dict[str, Learner] = {
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
SILVERBOX_SYSIDENTPY = SysIdentPy(lags=7, degree=2, terms=40, tolerance=0.999)
"""As in the case study of its book, which takes another model for each test part; those of 14 lags need gigabytes."""
PLANTS = {
    "Cascaded tanks": ("Cascaded tanks, validation", PLANT),
    "EMPS, four parameters": ("EMPS, pulses", PLANT),
    "EMPS, uneven friction": ("EMPS, pulses", UNEVEN),
}
"""Test and model of calibrated plants that the scenario of the grey boxes calls otherwise."""
LONGEST = {("silverbox", STATES): 60.0, ("bouc_wen", STATES): 50.0, ("silverbox", GROWN): 10.0}
"""How long these take, compared with the others: for the progress, and because several workers begin with the longest."""


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
    same_start: bool = False  # True if all parts begin in one state


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
    """Learn, run free, and write the table; Ctrl-C ends with the models that were learned until then."""
    tasks = (_silverbox(setting.data), _tanks(setting.data), _emps(setting.data), _bouc_wen(setting.data))
    record = setting.record(hashes(path for task in tasks for path in task.data.files))
    jobs = [(method, task.data) for task in tasks for method in (*task.data.further, *reversed(METHODS))]
    jobs.sort(key=_length, reverse=setting.jobs != 1)  # the longest first, unless an interrupt would keep less of them
    done: list[Outcome] = []
    plants: list[Judged] = []
    try:
        _learn(jobs, setting, done)
        setting.progress(0.95, "plants")
        plants += calibrated(setting.data, setting.jobs)
    except KeyboardInterrupt:
        if done:
            _written(setting, record, tasks, done, plants, f"Interrupted after {len(done)} of {len(jobs)} models. ")
        raise
    return _written(setting, record, tasks, done, plants)


def _length(job: tuple[str, DataSet]) -> float:
    method, data = job
    return LONGEST.get((data.name, method), 1.0)


def _learn(jobs: list[tuple[str, DataSet]], setting: Setting, done: list[Outcome]) -> None:
    """Learn all models, and tell how far that is by how long each takes."""
    left = set(range(len(jobs)))

    def tell() -> None:
        share = 1.0 - sum(_length(jobs[i]) for i in left) / sum(map(_length, jobs))
        still = [f", still {jobs[i][1].title}: {jobs[i][0]}" for i in sorted(left)[:1]]
        setting.progress(0.95 * share, f"{len(jobs) - len(left)} of {len(jobs)} models{''.join(still)}")

    tell()
    for number, outcome in jobs_as_they_end(learned, jobs, workers=setting.jobs):
        left.discard(number)
        tell()  # which raises where a fit was interrupted: what it found until then is no result
        done.append(outcome)


def _written(
    setting: Setting,
    record: RunRecord,
    tasks: Sequence[Task],
    done: list[Outcome],
    plants: list[Judged],
    ended: str = "",
) -> Mapping[str, Any]:
    """Judge the models, and write the page."""
    rows = [row for task in tasks for o in done if o.data == task.data.name for row in _judged(task, o)]
    rows += [_of_plant(one) for one in plants]
    measures = [_measure(row) for row in rows if row.model in CLAIMED]
    page = StoryPage(
        title="standard-tasks",
        sentence=f"{ended}The standard tasks, free runs over the official test parts: {reached(measures)} goals reached.",
        rows=measures,
        figures=[_drawn(rows)],
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
        Test(name="arrow-head, whole", recording=cut(ARROW), goal=0.26, published="0.26 (PNLSS)"),
        Test(name="arrow-head, inside", recording=cut(ARROW_INSIDE), goal=0.21, published="0.259 (GP-NARX)"),
    )
    peers = like_ours(known.candidates) | {SYSIDENTPY: SILVERBOX_SYSIDENTPY}
    return Task(
        data=replace(known, train=cut(SILVERBOX_TRAINING), parts=3, further=SILVERBOX_STATES | peers), tests=tests
    )


def _tanks(data: Path | None) -> Task:
    known = cascaded_tanks(data_folder(data, "cascaded_tanks"))
    published = "0.306; 0.396 (GRU)"
    test = Test(name="validation", recording=known.test, goal=0.30, published=published, shown=5)
    known = replace(known, further=TANKS_STATES | like_ours(known.candidates))
    return Task(data=known, tests=(test,), same_start=True)


def _emps(data: Path | None) -> Task:
    """Voltage to position in open loop; friction is known to turn with the velocity, and enters by its sign."""
    files = tuple(data_folder(data, "emps") / name for name in emps.FILES)
    train, test = (_averaged(file) for file in files)
    candidates = Candidates(
        output_lags=3,
        input_lags=(1, 2, 3),
        degree=1,
        max_terms=10,
        functions=("sign(y(k-1)-y(k-2))", "|y(k-1)-y(k-2)|"),
    )
    data_set = DataSet(
        name="emps_open",
        title="EMPS",
        train=train,
        test=test,
        unit="mm",
        scale=1e-3,
        files=files,
        candidates=candidates,
        further=EMPS_STATES | like_ours(replace(candidates, degree=3)),
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
    published, further = "18.7 (PNLSS), 45.2 (dynoNet)", BOUC_WEN_STATES | like_ours(known.candidates)
    tests = []
    for name, kept in (("multisine", "multisine"), ("sweep", "sinesweep")):  # as sampled; plants get held values
        force, motion = hdf5_vectors(folder / "test.h5", kept, ("u", "y"))
        record = replace(known.test, inputs=force[None], outputs=motion[None])
        tests.append(Test(name=name, recording=record, goal=15.0, published=published))
    return Task(data=replace(known, unit="µm", scale=1e-6, further=further), tests=tuple(tests))


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
    task, model = PLANTS.get(one.task.name, (one.task.name, PLANT))
    return Row(
        task=task,
        model=model,
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
            "Left of the dotted line a goal is reached; runs that are off by more than a hundred times the goal are left "
            "out. Tests are numbered from above in the data.",
            columns,
        )


def _plain(row: Row) -> dict[str, Any]:
    error = row.error if np.isfinite(row.error) else None
    return {"task": row.task, "model": row.model, "size": row.size, "error": error, "unit": row.unit}
