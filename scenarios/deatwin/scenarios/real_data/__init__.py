"""Free runs on real recordings of others: a converter, an oscillator, two tanks and a positioning system.

The recordings are public and read where the user keeps them (``--data`` or ``DEATWIN_DATA``), or downloaded as far as
nonlinear_benchmarks has them. Each method gets the same candidates, learns from the training recording alone and runs
free over the test recording from its first samples. Nothing is chosen on a test recording. What others report for the
same recordings stands beside it, with its source."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.ident import run_jobs
from deatwin.ident.narx import NarxModel
from deatwin.plant import Recording
from deatwin.plant.arrays import Array
from deatwin.studies.provenance import hashes
from deatwin.studies.public.black_boxes import FROLS, GROWN, LINEAR, METHODS, REFINED, SEMP, Outcome, attempt
from deatwin.studies.public.records import DataSet, buck, cascaded_tanks, emps, silverbox
from deatwin.studies.public.sources import data_folder, origins
from deatwin.studies.report.drawing import Drawing, Hue, draw, draw_runs, legend_above
from deatwin.studies.report.story import Measure, StoryPage, Table, finish, reached
from deatwin.studies.report.words import Words, notes
from deatwin.studies.stories import Setting

_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("published.toml").read_text(encoding="utf-8"))
DOCUMENTED: Mapping[str, Mapping[str, float]] = _FILE["documented"]
"""Models of the buck converter in SysIdentPy's documentation, in its order: parameters by term."""
QUOTED = [[" ".join(one[key].split()) for key in ("data", "method", "error", "source")] for one in _FILE["quoted"]]
"""Rows of data set, method, error as it is reported, and where."""


def documented_errors(test: Recording) -> dict[str, float]:
    """Root mean square errors of free runs of the documented models, V."""
    return {
        name: NarxModel.from_terms(terms, sample_time=test.sample_time).simulate(test).rms_error
        for name, terms in DOCUMENTED.items()
    }


WORDS = Words(__package__)
LARGEST_ERROR, MOST_TERMS = 0.35e-3, 15  # Demanded of the Silverbox, V and terms
SETS: Mapping[str, Callable[[Path], DataSet]] = MappingProxyType(
    {"silverbox": silverbox, "buck_converter": buck, "cascaded_tanks": cascaded_tanks, "emps": emps}
)
"""Loaders by the name of the set's folder, in the order of the page."""
Outcomes = Mapping[str, Mapping[str, Outcome]]
WINDOW = 500  # Samples of a running root mean square
ZOOM = 120  # Samples around the largest output that are drawn


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify all recordings with all methods, compare the errors, and draw them."""
    sets = [load(data_folder(setting.data, name)) for name, load in SETS.items()]
    record = setting.record(hashes(path for data in sets for path in data.files))
    tasks = [(method, data) for data in sets for method in reversed(list(METHODS))]  # the longest first
    setting.progress(0.0, f"{len(tasks)} models")
    done = run_jobs(
        attempt,
        tasks,
        workers=setting.jobs,
        finished=lambda count: setting.progress(0.9 * count / len(tasks), f"{count} of {len(tasks)} models"),
    )
    outcomes = {data.name: {o.method: o for o in reversed(done) if o.data == data.name} for data in sets}
    every = [o for own in outcomes.values() for o in own.values()]
    setting.progress(0.9, "drawing")
    rows = judge(sets, outcomes)
    best, data = outcomes["silverbox"][GROWN], sets[0]
    page = StoryPage(
        title="real-data",
        sentence=WORDS.text("sentence", error=best.free_run / data.scale, terms=best.terms, reached=reached(rows)),
        rows=rows,
        notes=notes(
            __package__,
            sets={d.title: WORDS.text(f"note.{d.name}") for d in sets},
            refined=REFINED,
            semp=SEMP,
            grown=GROWN,
        ),
        figures=[
            _arrow_head(data, outcomes["silverbox"]),
            _converter(sets[1], outcomes["buck"]),
            *(_free_runs(d, outcomes[d.name]) for d in sets[2:]),
        ],
        tables=[
            *(_table(d, outcomes[d.name]) for d in sets),
            WORDS.table("quoted", QUOTED),
            origins(setting.data, {name: data.files for name, data in zip(SETS, sets, strict=True)}),
        ],
    )
    return finish(
        setting.folder,
        record,
        page,
        outcomes=[o.plain for o in every],
        documented_V=documented_errors(sets[1].test),
    )


def judge(sets: Sequence[DataSet], outcomes: Outcomes) -> list[Measure]:
    """Compare the errors with their goals."""
    oscillator, box, converter = sets[0], outcomes["silverbox"], outcomes["buck"]
    best, semp, simple, linear = (box[m].free_run / oscillator.scale for m in (GROWN, SEMP, FROLS, LINEAR))
    limit = LARGEST_ERROR / oscillator.scale
    documented = min(documented_errors(sets[1].test).values())
    refined, numbers = converter[REFINED].free_run, {"method": REFINED, "documented": documented}
    grown, small = box[GROWN].terms, best <= limit and box[GROWN].terms <= MOST_TERMS
    return [
        WORDS.measure("grown", small, limit=limit, most=MOST_TERMS, error=best, terms=grown),
        WORDS.measure("semp", semp < simple, other=simple, error=semp, terms=box[SEMP].terms),
        WORDS.measure("linear", best < 0.1 * linear, other=linear, error=best),
        WORDS.measure("converter", refined <= documented, **numbers, error=refined, terms=converter[REFINED].terms),
    ]


def _table(data: DataSet, outcomes: Mapping[str, Outcome]) -> Table:
    def shown(value: float) -> str:
        return f"{value / data.scale:.4f}" if value == value else "–"

    rows = []
    for o in outcomes.values():
        errors = [shown(o.one_step), o.failure or shown(o.free_run), shown(o.training)]
        rows.append([o.method, str(o.terms), *errors, f"{o.seconds:.1f}"])
    return WORDS.table("errors", rows, data=data.title, unit=data.unit)


def _key(method: str) -> str:
    return method.replace(",", "").replace(" ", "_")


def _running(values: Array) -> Array:
    """Return the root mean square of each complete window."""
    count = values.size // WINDOW
    return np.sqrt(np.mean(values[: count * WINDOW].reshape(count, WINDOW) ** 2, axis=1))


def _arrow_head(data: DataSet, outcomes: Mapping[str, Outcome]) -> Drawing:
    """Draw the Silverbox over its growing amplitude, with errors of a linear and of two nonlinear models."""
    measured, step = data.test.outputs[0] / data.scale, data.test.sample_time
    timepts = (np.arange(measured.size // WINDOW) + 0.5) * WINDOW * step
    learned = np.abs(data.train.outputs).max() / data.scale
    columns: dict[str, Array] = {"time_s": timepts, "output_rms_mV": _running(measured)}
    peak = int(np.argmax(np.abs(measured)))
    near = slice(max(peak - ZOOM // 2, 0), min(peak + ZOOM // 2, measured.size))
    with draw((9.6, 6.6)) as figure:
        top, middle, bottom = figure.subplots(3, 1, height_ratios=(2, 3, 3))
        top.plot(data.test.timepts[::4], measured[::4], color=Hue.MEASURED, linewidth=0.3)
        for side in (-1, 1):
            top.axhline(side * learned, color=Hue.INK, linestyle=":", linewidth=0.9)
        top.set(ylabel="output (mV)")
        for method, colour in ((LINEAR, Hue.BEFORE), (FROLS, Hue.MARK), (GROWN, Hue.AFTER)):
            error = measured - outcomes[method].outputs / data.scale
            label = f"{method}, {outcomes[method].terms} parameters"
            middle.semilogy(timepts, _running(error), "-", color=colour, label=label)
            columns[f"{_key(method)}_mV"] = _running(error)
            if method != FROLS:
                shown = outcomes[method].outputs[near] / data.scale
                bottom.plot(data.test.timepts[near], shown, color=colour, linewidth=1.4)
        middle.semilogy(timepts, columns["output_rms_mV"], "--", color=Hue.MEASURED, label="output itself")
        middle.set(ylabel=f"rms of {WINDOW} samples (mV)", xlabel="time (s)")
        bottom.plot(data.test.timepts[near], measured[near], ".", color=Hue.INK, markersize=3.5)
        bottom.set(ylabel="output (mV)", xlabel="time (s)")
        legend_above(figure, middle, 2)
        return WORDS.drawing(figure, "arrow_head", columns)


def _converter(data: DataSet, outcomes: Mapping[str, Outcome]) -> Drawing:
    """Draw the buck converter's free run and that of the documented model."""
    name, terms = next(iter(DOCUMENTED.items()))
    theirs = NarxModel.from_terms(terms, sample_time=data.test.sample_time).simulate(data.test).outputs[0]
    runs = {LINEAR: outcomes[LINEAR].outputs, name: theirs, REFINED: outcomes[REFINED].outputs}
    return _runs(data, runs, "converter", method=REFINED)


def _free_runs(data: DataSet, outcomes: Mapping[str, Outcome]) -> Drawing:
    """Draw free runs of three methods over the test recording, with their errors."""
    runs = {method: outcomes[method].outputs for method in (LINEAR, REFINED, GROWN) if not outcomes[method].failure}
    return _runs(data, runs, "free_run", data.name, data=data.title, note=WORDS.text(f"note.{data.name}"))


def _runs(shown: DataSet, runs: Mapping[str, Array], name: str, called: str = "", **said: str) -> Drawing:
    measured, timepts = shown.test.outputs[0] / shown.scale, shown.test.timepts
    size, unit = (1e3, "ms") if name == "converter" and shown.test.sample_time < 1e-3 else (1.0, "s")
    scaled = {method: outputs / shown.scale for method, outputs in runs.items()}
    columns = {"time_s": timepts, "measured": measured, **{_key(method): run for method, run in scaled.items()}}
    with draw((9.6, 4.8)) as figure:
        draw_runs(figure, size * timepts, measured, scaled, shown.unit, f"time ({unit})")
        return WORDS.drawing(figure, name, columns, called, **said)
