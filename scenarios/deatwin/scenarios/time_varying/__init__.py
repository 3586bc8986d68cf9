"""Parameters that change with time, and what they do to every order of the frequency response.

First systems whose parameters are known at each instant: a smoother finds them, and the responses frozen in time are
held against truth, against the rate of variation, and for how often their bands cover. Then the six actuators: mean and
gain in sliding windows before any fit, parameters of a fixed structure along the record, the equilibrium, TV-GFRFs and
TV-NOFRFs, the output's short-time spectrum against the recording's, and what varying parameters are worth on samples
that they have not seen.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deatwin.ident.narx.wander import CONSTANT, VARYING
from deatwin.scenarios.time_varying.benchmark_figures import benchmark_drawings
from deatwin.scenarios.time_varying.fleet_figures import fleet_drawings, key_of
from deatwin.scenarios.time_varying.fleet_maps import map_drawings
from deatwin.scenarios.time_varying.notes import notes
from deatwin.scenarios.time_varying.study import Study, carry_out
from deatwin.scenarios.time_varying.verdicts import judge
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run"]

SAVED_EVERY = 20
"""Of the trajectories' times every so many are saved: covariances of every second are large."""


def run(setting: Setting) -> Mapping[str, Any]:
    """Follow known systems and the fleet along time."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    study = carry_out(setting.seed, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.92, "judging and drawing")
    rows = judge(study)
    unseen = {way: [100 * one.track.unseen[way] for one in study.driven] for way in (CONSTANT, VARYING)}
    sentence = (
        "Six actuators, one structure: on blocks left out of the fit free runs miss by "
        f"{min(unseen[CONSTANT]):.0f} to {max(unseen[CONSTANT]):.0f} % of the reading's deviation with constant "
        f"parameters and by {min(unseen[VARYING]):.0f} to {max(unseen[VARYING]):.0f} % with parameters that vary; "
        f"{sum(row.passed for row in rows)} of {len(rows)} stated measures are reached."
    )
    drawn = [*benchmark_drawings(study.benchmark), *fleet_drawings(study), *map_drawings(study.shown)]
    for drawing, columns in drawn:
        setting.folder.csv(drawing.data, columns)
    for one in study.driven:
        saved = one.track.trajectory.thinned(SAVED_EVERY)
        setting.folder.save(f"theta/{key_of(one).lower()}.json", saved.save)
    page = StoryPage(
        title="time-varying", sentence=sentence, rows=rows, notes=notes(study), figures=[d for d, _ in drawn]
    )
    write_story(setting.folder, page, record)
    result = {"sentence": sentence, "measures": [asdict(row) for row in rows], "actuators": _errors(study)}
    setting.folder.text("time-varying.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _errors(study: Study) -> list[dict[str, Any]]:
    """Free-run errors of each actuator over its reading's deviation, as plain data."""
    return [
        {
            "actuator": one.name,
            "share": one.track.share,
            "seen": dict(one.track.seen),
            "unseen": dict(one.track.unseen),
            "ahead": dict(one.track.ahead),
        }
        for one in study.driven
    ]
