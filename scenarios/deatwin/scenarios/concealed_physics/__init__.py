"""What the mismatch engine is worth: effects are concealed from it, and it has to find them.

A generator that shares no mechanism with the catalogue makes recordings: some clean, some with one effect, two, or one
that no catalogue has. The diagnosis is given the nominal plant and the recordings. Labels, thresholds and code are
hashed before the first case, and the key is opened when the last is through.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from deatwin.scenarios.concealed_physics.figures import drawings, summary
from deatwin.scenarios.concealed_physics.opened import FAR, Opened, open_key
from deatwin.scenarios.concealed_physics.page import results_page, write_results
from deatwin.scenarios.concealed_physics.score import score, sentence
from deatwin.scenarios.concealed_physics.seal import Seal
from deatwin.scenarios.concealed_physics.study import carry_out, key_of, labels
from deatwin.scenarios.concealed_physics.tables import csv_files, reported, tables
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import Note, StoryPage, write_story
from deatwin.studies.stories import Setting

__all__ = ["run", "write_results"]

SIZE = "standard"


def run(setting: Setting) -> Mapping[str, Any]:
    """Run the cases that have no result yet, open the key, count, draw."""
    record = RunRecord(command=setting.command, inputs=[], seed=setting.seed, jobs=setting.jobs)
    size = setting.size or SIZE
    setting.folder.written.extend(("seal.json", "cases"))  # by the store, as soon as it begins
    store = carry_out(setting.folder.path, size, setting.seed, setting.jobs, setting.progress)
    setting.progress(1.0, "opening the key")
    key = key_of(labels(size, setting.seed))
    study = open_key(store, key)
    setting.folder.text("key.json", json.dumps(key, indent=1) + "\n")
    goals = score(study)
    line = sentence(study, goals)
    figures, data = drawings(study)
    for name, text in {**csv_files(study, goals), **data}.items():
        setting.folder.text(name, text)
    setting.folder.text("summary.svg", summary(study))
    setting.folder.text("results.md", results_page(study, goals, store.seal))
    page = StoryPage(
        title="concealed-physics",
        sentence=line,
        rows=[goal.row for goal in goals if goal.met is not None],
        notes=_notes(study, store.seal, Seal.of(size, setting.seed, key)),
        figures=figures,
        tables=[reported(goals), *tables(study, store.seal)],
    )
    write_story(setting.folder, page, record)
    result = {"sentence": line, "seal": store.seal.hash, "goals": [asdict(goal) for goal in goals], **_counts(study)}
    setting.folder.text("concealed-physics.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _counts(study: Opened) -> dict[str, Any]:
    return {"cases": len(study.cases), "interval_parameters": len(study.intervals), "failures": dict(study.failures)}


def _notes(study: Opened, sealed: Seal, now: Seal) -> Sequence[Note]:
    scoring = (
        "The code that counts is the one that was there when the study was sealed."
        if sealed.scoring == now.scoring
        else "The code that counts has changed since the study was sealed; the code that ran the cases has not."
    )
    seconds = np.array(study.seconds or (0.0,))
    return [
        Note(
            title="What was sealed",
            paragraphs=[
                f"Labels, every threshold of the engine and the code were hashed before the first case: {sealed.hash}. "
                f"Each case bears this hash. {scoring}"
            ],
        ),
        Note(
            title="How it is counted",
            paragraphs=[
                "Ratio is the rms of what a concealed effect leaves after the base plant was refitted, over that "
                "of the sensor's noise. A name is right if the key accepts it for the mechanism; the key was "
                "written before any case was run. Confident is a cause under the verdict named. A case that ended "
                "in an error is counted as one that missed. d² is what the diagnosis itself states; a rival that "
                f"it does not state counts as far. From {FAR:g} on two explanations can be told apart.",
                "The oracle is told the effect. It fits the same reduced plant with the catalogue's form of it to "
                "the same recordings. All plants run free over the check record, which comes after the recordings "
                "and which no fit has seen.",
                _told_of_mass(study),
                "Baselines learn the residual of the same calibrated base plant. The sparse dynamics are pysindy's "
                "weak form with an ensemble; its strongest term counts as right if any of the effects that such a "
                "term may stand for is. A run of it that diverges counts as no correction.",
                f"Bounds of rates are exact. Processor time of a case: median {np.median(seconds):.0f} s, at most "
                f"{seconds.max():.0f} s.",
            ],
        ),
    ]


def _told_of_mass(study: Opened) -> str:
    advised = [case for case in study.of("tie") if "verdict" in (case.result.get("advised") or {})]
    return (
        "Where an experiment is advised, it is recorded and diagnosed together with the first recordings. Where a mass "
        "is to be added for it, the rig is another one: that record is diagnosed alone, with the tied effects as the "
        "whole catalogue, which is easier than to find the effect among all. "
        f"{sum(case.heavier for case in advised)} of {len(advised)} advised experiments were of this kind."
    )
