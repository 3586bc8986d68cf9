"""Free runs on real recordings of others: a converter, an oscillator, two tanks and a positioning system.

The recordings are public and read where the user keeps them (``--data`` or ``DEATWIN_DATA``), or downloaded as far as
nonlinear_benchmarks has them. Each method gets the same candidates, learns from the training recording alone and runs
free over the test recording from its first samples. Nothing is chosen on a test recording. What others report for the
same recordings stands beside it, with its source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from deatwin.ident import run_jobs
from deatwin.scenarios.real_data import figures
from deatwin.scenarios.real_data.published import QUOTED, documented_errors
from deatwin.studies.provenance import hashes
from deatwin.studies.public.black_boxes import FRO, GROWN, LINEAR, METHODS, REFINED, SEMP, Outcome, attempt
from deatwin.studies.public.records import DataSet, buck, cascaded_tanks, emps, silverbox
from deatwin.studies.public.sources import data_folder, origins
from deatwin.studies.report.prose import notes
from deatwin.studies.report.story import Measure, StoryPage, Table, finish, reached
from deatwin.studies.report.words import Words
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
LARGEST_ERROR, MOST_TERMS = 0.35e-3, 15  # Demanded of the Silverbox, V and terms
SETS: Mapping[str, Callable[[Path], DataSet]] = MappingProxyType(
    {"silverbox": silverbox, "buck_converter": buck, "cascaded_tanks": cascaded_tanks, "emps": emps}
)
"""Loaders by the name of the set's folder, in the order of the page."""
Outcomes = Mapping[str, Mapping[str, Outcome]]


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
        notes=notes(__package__, sets=sets, refined=REFINED, semp=SEMP, grown=GROWN),
        figures=[
            figures.arrow_head(data, outcomes["silverbox"]),
            figures.converter(sets[1], outcomes["buck"]),
            *(figures.free_runs(d, outcomes[d.name], (LINEAR, REFINED, GROWN)) for d in sets[2:]),
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
    best, semp, simple, linear = (box[m].free_run / oscillator.scale for m in (GROWN, SEMP, FRO, LINEAR))
    limit = LARGEST_ERROR / oscillator.scale
    documented = min(documented_errors(sets[1].test).values())
    refined = converter[REFINED].free_run
    grown, small = box[GROWN].terms, best <= limit and box[GROWN].terms <= MOST_TERMS
    return [
        WORDS.measure("grown", small, method=GROWN, limit=limit, most=MOST_TERMS, error=best, terms=grown),
        WORDS.measure("semp", semp < simple, other=simple, error=semp, terms=box[SEMP].terms),
        WORDS.measure("linear", best < 0.1 * linear, method=GROWN, other=linear, error=best),
        WORDS.measure(
            "converter",
            refined <= documented,
            method=REFINED,
            documented=documented,
            error=refined,
            terms=converter[REFINED].terms,
        ),
    ]


def _table(data: DataSet, outcomes: Mapping[str, Outcome]) -> Table:
    def shown(value: float) -> str:
        return f"{value / data.scale:.4f}" if value == value else "–"

    rows = [
        [
            o.method,
            str(o.terms),
            shown(o.one_step),
            o.failure or shown(o.free_run),
            shown(o.training),
            f"{o.seconds:.1f}",
        ]
        for o in outcomes.values()
    ]
    return WORDS.table("errors", rows, data=data.title, unit=data.unit)
