"""Free runs on real recordings of others: a converter, an oscillator, two tanks and a positioning system.

The recordings are public and read where the user keeps them (``--data`` or ``DEATWIN_DATA``), or downloaded as far as
nonlinear_benchmarks has them. Each method gets the same candidates, learns from the training recording alone and runs
free over the test recording from its first samples. Nothing is chosen on a test recording. What others report for the
same recordings stands beside it, with its source.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from deatwin.ident.parallel import run_jobs
from deatwin.scenarios.real_data import figures
from deatwin.scenarios.real_data.published import QUOTED, documented_errors
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.public.black_boxes import FRO, GROWN, LINEAR, METHODS, REFINED, SEMP, Outcome, attempt
from deatwin.studies.public.records import DataSet, buck, cascaded_tanks, emps, silverbox
from deatwin.studies.public.sources import data_folder, origins
from deatwin.studies.report.story import Note, Row, StoryPage, Table, write_story
from deatwin.studies.stories import Setting

__all__ = ["LARGEST_ERROR", "MOST_TERMS", "SETS", "judge", "run"]

LARGEST_ERROR, MOST_TERMS = 0.35e-3, 15
"""Demanded of the Silverbox, V and terms."""
SETS: Mapping[str, Callable[[Path], DataSet]] = MappingProxyType(
    {"silverbox": silverbox, "buck_converter": buck, "cascaded_tanks": cascaded_tanks, "emps": emps}
)
"""By the name of the set's folder, in the order of the page."""
Outcomes = Mapping[str, Mapping[str, Outcome]]


def run(setting: Setting) -> Mapping[str, Any]:
    """Let all methods learn, judge and draw them."""
    sets = [load(data_folder(setting.data, name)) for name, load in SETS.items()]
    record = RunRecord(
        command=setting.command,
        inputs=hashes(path for data in sets for path in data.files),
        seed=setting.seed,
        jobs=setting.jobs,
    )
    tasks = [(method, data) for data in sets for method in reversed(list(METHODS))]  # the longest first
    setting.progress(0.0, f"{len(tasks)} models")
    done = run_jobs(
        attempt,
        tasks,
        workers=setting.jobs,
        finished=lambda count: setting.progress(0.9 * count / len(tasks), f"{count} of {len(tasks)} models"),
    )
    outcomes = {data.name: {o.method: o for o in reversed(done) if o.data == data.name} for data in sets}
    setting.progress(0.9, "drawing")
    return _written(setting, sets, outcomes, record)


def _written(setting: Setting, sets: Sequence[DataSet], outcomes: Outcomes, record: RunRecord) -> Mapping[str, Any]:
    rows = judge(sets, outcomes)
    best, data = outcomes["silverbox"][GROWN], sets[0]
    sentence = (
        f"Free runs on recordings of others: the Silverbox' arrow-head to {best.free_run / data.scale:.3f} mV rms with "
        f"{best.terms} terms learned from the multisine; {sum(row.passed for row in rows)} of {len(rows)} measures "
        "reached."
    )
    made = [
        figures.comparison(sets, [o for own in outcomes.values() for o in own.values()]),
        figures.arrow_head(data, outcomes["silverbox"]),
        figures.arrow_head_spectra(data, outcomes["silverbox"]),
        figures.converter(sets[1], outcomes["buck"]),
        *(figures.free_runs(d, outcomes[d.name], (LINEAR, REFINED, GROWN)) for d in sets[2:]),
    ]
    for drawing, columns in made:
        setting.folder.csv(drawing.data, columns)
    page = StoryPage(
        title="real-data",
        sentence=sentence,
        rows=rows,
        notes=_notes(sets),
        figures=[drawing for drawing, _ in made],
        tables=[
            *(_table(d, outcomes[d.name]) for d in sets),
            _quoted(),
            origins(setting.data, {name: data.files for name, data in zip(SETS, sets, strict=True)}),
        ],
    )
    write_story(setting.folder, page, record)
    result = {
        "sentence": sentence,
        "measures": [asdict(row) for row in rows],
        "outcomes": [o.plain for own in outcomes.values() for o in own.values()],
        "documented_V": documented_errors(sets[1].test),
    }
    setting.folder.text("real-data.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def judge(sets: Sequence[DataSet], outcomes: Outcomes) -> list[Row]:
    """Hold the outcomes against what is demanded."""
    oscillator, box, converter = sets[0], outcomes["silverbox"], outcomes["buck"]
    best, semp, simple, linear = (box[m].free_run / oscillator.scale for m in (GROWN, SEMP, FRO, LINEAR))
    limit = LARGEST_ERROR / oscillator.scale
    documented = min(documented_errors(sets[1].test).values())
    refined = converter[REFINED].free_run
    return [
        Row(
            measure=f"Silverbox, {GROWN}: free run over the arrow-head, learned from the multisine",
            demanded=f"at most {limit:g} mV rms with at most {MOST_TERMS} terms",
            reached=f"{best:.4f} mV with {box[GROWN].terms}",
            passed=best <= limit and box[GROWN].terms <= MOST_TERMS,
        ),
        Row(
            measure="Silverbox: SEMP against FRO from the same candidates with as many terms",
            demanded=f"below {simple:.4f} mV",
            reached=f"{semp:.4f} mV with {box[SEMP].terms}",
            passed=semp < simple,
        ),
        Row(
            measure=f"Silverbox: {GROWN}, against a linear model (output error)",
            demanded=f"below a tenth of {linear:.2f} mV",
            reached=f"{best:.4f} mV",
            passed=best < 0.1 * linear,
        ),
        Row(
            measure=f"Buck converter, {REFINED}: free run on buck_valid, candidates as in SysIdentPy's documentation",
            demanded=f"at most {documented:.4f} V rms, the least of its six documented models",
            reached=f"{refined:.4f} V with {converter[REFINED].terms} terms",
            passed=refined <= documented,
        ),
    ]


def _notes(sets: Sequence[DataSet]) -> list[Note]:
    return [
        Note(title="What was learned from, and judged on", paragraphs=[f"{d.title}. {d.note}" for d in sets]),
        Note(
            title="What the free run asks for",
            paragraphs=[
                "Least squares of the one-step error takes the noise of the readings for the system's own, and its "
                "parameters are biased. Where the free run is what counts, they are estimated by its own error: "
                f"“{REFINED}” has the terms of FRO and only other parameters.",
                f"“{SEMP}” chooses terms by the free run, and estimates them by one step. “{GROWN}” minimises the "
                "error of the free run over structure and parameters: it begins with a linear model, adds the terms "
                "that lower that error most, half as many again as allowed, and takes the least useful out, all "
                "parameters refined after each. The last third of the training recording, held out, says how many "
                "stay. On the long multisine it does so in each quarter, and the structure that runs best over all "
                "four is kept.",
                f"Which method stands in a measure was fixed for each recording, the Silverbox by “{GROWN}” and the "
                f"converter by “{REFINED}”; either would miss the other's measure, and the training errors would have "
                "chosen otherwise on the converter: the table has every method. SVB is the published algorithm, "
                "without the clean-up.",
                "The other recordings are reported without a demand. A polynomial has neither the tanks' overflow nor "
                "Coulomb friction, and may diverge beyond what it has learned from; the table says where and when.",
            ],
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
    columns = [
        "method",
        "parameters",
        f"one step, test ({data.unit})",
        f"free run, test ({data.unit})",
        f"free run, training ({data.unit})",
        "time to learn (s)",
    ]
    return Table(title=f"{data.title}: root mean square errors", columns=columns, rows=rows)


def _quoted() -> Table:
    return Table(
        title="Reported by others",
        columns=["recordings", "method", "error", "source"],
        rows=[[q.data, q.method, q.error, q.source] for q in QUOTED],
    )
