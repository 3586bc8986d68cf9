"""Would the controller survive the real actuator? The control-design check, held against rigs that it does not see.

What an inverse feedforward buys, and how near it comes to a design on the true plant; one schedule on six actuators;
five models of one actuator, what each promises and gets; a concealed effect, and designs before and after its
diagnosis; and random rigs with random designs: how often a verdict keeps its word.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from typing import Any

from deatwin.scenarios.concealed_physics.rates import bounds
from deatwin.scenarios.control_check.check_figures import check_drawings
from deatwin.scenarios.control_check.concealed import Concealed
from deatwin.scenarios.control_check.loop_figures import loop_drawings
from deatwin.scenarios.control_check.notes import answer, notes
from deatwin.scenarios.control_check.promises import promises
from deatwin.scenarios.control_check.rates import caught, inside, sound
from deatwin.scenarios.control_check.study import Study, carry_out
from deatwin.scenarios.control_check.tables import tables
from deatwin.scenarios.control_check.tracking import Tracking
from deatwin.scenarios.control_check.verdicts import judge
from deatwin.scenarios.svb_benchmark.trials import Rate
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]

SIZE = "short"


def run(setting: Setting) -> Mapping[str, Any]:
    """Design, check, try on the truth, draw and judge."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    setting.folder.written.extend(("seal.json", "trials"))  # trials are there as soon as they are through
    study = carry_out(setting.folder.path, setting.size or SIZE, setting.seed, setting.jobs, setting.progress)
    setting.progress(1.0, "judging and drawing")
    rows = judge(study)
    sentence = answer(study, rows)
    loops, checks = loop_drawings(study), check_drawings(study)
    for drawing, columns in loops:
        setting.folder.csv(drawing.data, columns)
    for drawing, text in checks:
        setting.folder.text(drawing.data, text)
    page = StoryPage(
        title="control-check",
        sentence=sentence,
        rows=rows,
        notes=notes(study),
        figures=[drawing for drawing, _ in (*loops, *checks)],
        tables=tables(study),
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows], **_summary(study)}
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    setting.folder.text("control-check.json", text)
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _summary(study: Study) -> dict[str, Any]:
    """Return what was found as plain data, SI."""
    outcomes = study.outcomes
    return {
        "tracking": {tracking.name: _tracked(tracking) for tracking in study.tracking},
        "fleet": [
            {
                "actuator": r.actuator.name,
                "stable": r.stable,
                "overshoot": r.steps.overshoot,
                "ripple": r.steps.ripple,
                "tones_rms_error": r.tones.rms_error,
            }
            for r in study.fleet
        ],
        "models": [
            {
                "model": p.model,
                "quantity": p.quantity.column,
                "predicted": _finite(p.predicted.value),
                "low": _finite(p.predicted.low),
                "high": _finite(p.predicted.high),
                "achieved": _finite(p.achieved),
                "inside": p.kept,
            }
            for p in promises(study.matters)
        ],
        "concealed": [_designs(one) for one in study.concealed],
        "rates": {
            "passed_inside_the_band": _rate(inside(outcomes)),
            "passed_sound": _rate(sound(outcomes)),
            "unsound_not_passed": _rate(caught(outcomes)),
        },
        "trials": [outcome.to_dict() for outcome in outcomes],
    }


def _tracked(tracking: Tracking) -> dict[str, Any]:
    return {
        name: {
            "rms_error": _finite(one.rms),
            "gain_margin": _finite(float(one.margins.gain[0])),
            "phase_margin_deg": _finite(float(one.margins.phase_deg[0])),
            "status": one.run.status.name.lower(),
        }
        for name, one in tracking.tracked.items()
    }


def _designs(one: Concealed) -> dict[str, Any]:
    return {
        "effect": one.effect,
        "diagnosis": one.diagnosis.verdict.value,
        "causes": [cause.effect for cause in one.diagnosis.causes],
        "designs": [
            {
                "source": d.source,
                "closed_loop_time": d.controller.closed_loop_time,
                "controller": d.controller.name,
                "verdict": d.check.verdict.value,
                "reason": d.check.reason,
                "truth": d.truth.verdict.value,
                "true_text": d.truth.text,
            }
            for d in (*one.designs, *one.at_other_times)
        ],
    }


def _rate(rate: Rate) -> dict[str, Any]:
    low, high = bounds(rate)
    return {"hits": rate.hits, "count": rate.count, "low": low, "high": high}


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
