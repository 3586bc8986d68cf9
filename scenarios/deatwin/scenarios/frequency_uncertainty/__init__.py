"""What is known of a frequency response, and where six actuators of one specification differ.

The uncertainty of a model's parameters is propagated to its frequency responses of every order and held against Monte
Carlo, for systems whose equations are known: where the law of propagation holds, and where it fails. Then the thesis'
question: how consistent is fabrication? Six actuators are compared by order and band, beside repeats of one of them,
which must not differ, and drift within a record is told apart from difference between actuators.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.ident.frequency.comparison.compare import Comparison
from deatwin.scenarios.frequency_uncertainty.benchmark_figures import benchmark_drawings
from deatwin.scenarios.frequency_uncertainty.fleet_figures import fleet_drawings
from deatwin.scenarios.frequency_uncertainty.notes import answer, notes
from deatwin.scenarios.frequency_uncertainty.study import Plan, Study, carry_out
from deatwin.scenarios.frequency_uncertainty.tables import tables
from deatwin.scenarios.frequency_uncertainty.verdicts import judge
from deatwin.studies.report.story import StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]

PLAN = Plan()


def run(setting: Setting) -> Mapping[str, Any]:
    """Record, propagate, draw and compare."""
    record = setting.record()
    study = carry_out(setting.seed, PLAN, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.95, "judging and drawing")
    rows = judge(study)
    sentence = (
        f"{answer(study.consistency)} {sum(row.passed for row in rows)} of {len(rows)} stated measures are reached."
    )
    made = [*benchmark_drawings(study.benchmarks), *fleet_drawings(study.consistency)]
    for drawing, columns in made:
        setting.folder.csv(drawing.data, columns)
    page = StoryPage(
        title="frequency-uncertainty",
        sentence=sentence,
        rows=rows,
        notes=notes(study),
        figures=[drawing for drawing, _ in made],
        tables=tables(study),
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows], **_summary(study)}
    setting.folder.text("frequency-uncertainty.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _summary(study: Study) -> dict[str, Any]:
    """Return differences, drifts and spreads as plain data."""
    fleet = study.consistency
    return {
        "columns": [dict(zip(("order", "from_Hz", "to_Hz"), column, strict=True)) for column in fleet.columns],
        "spread": {
            "predicted": fleet.predicted.tolist(),
            **{group: fleet.spread(group).tolist() for group in ("level", "steady", "fleet")},
        },
        "tables": {group: _plain(fleet.tables[group]) for group in ("fleet", "steady", "shared")},
    }


def _plain(table: Comparison) -> dict[str, Any]:
    place = ("order", "from_Hz", "to_Hz")
    return {
        "level": table.level,
        "differences": [
            {
                "first": d.first,
                "second": d.second,
                **{key: getattr(d, key) for key in place},
                "size": d.size,
                "p_value": d.p_value,
                "adjusted": d.adjusted,
                "agreement": d.agreement.name.lower(),
            }
            for d in table.differences
        ],
        "drifts": [
            {
                "name": d.name,
                **{key: getattr(d, key) for key in place},
                "size": d.size,
                "p_value": d.p_value,
                "adjusted": d.adjusted,
                "drifts": d.drifts,
            }
            for d in table.drifts
        ],
    }
