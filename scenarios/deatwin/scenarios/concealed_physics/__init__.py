"""Measure how well the mismatch engine finds effects that are concealed from it.

A generator that shares no mechanism with the catalogue makes recordings: some clean, some with one effect, two, or one
that no catalogue has. The diagnosis is given the nominal plant and the recordings. Labels, thresholds and code are
hashed before the first case, and the key is opened when the last is through.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from deatwin.scenarios.concealed_physics.cases import case_specs
from deatwin.scenarios.concealed_physics.page import drawings, reported, summary, tables
from deatwin.scenarios.concealed_physics.results import FAR, open_key, score, sentence
from deatwin.scenarios.concealed_physics.study import carry_out, key_of
from deatwin.studies.report.story import Measure, StoryPage, end_run, write_story
from deatwin.studies.report.words import notes
from deatwin.studies.stories import Setting

SIZE = "standard"


def run(setting: Setting) -> Mapping[str, Any]:
    """Run the cases that have no result yet, compare the results with the key, and write the report."""
    record, folder = setting.record(), setting.folder
    size = setting.size or SIZE
    folder.written.extend(("seal.json", "cases"))  # by the store, as soon as it begins
    store = carry_out(folder.path, size, setting.seed, setting.jobs, setting.progress)
    setting.progress(1.0, "opening the key")
    key = key_of(case_specs(size, setting.seed))
    study = open_key(store, key)
    goals, seconds = score(study), np.array(study.seconds or (0.0,))
    advised = [case for case in study.of("tie") if case.again]
    folder.text("key.json", json.dumps(key, indent=1) + "\n")
    folder.text("summary.svg", summary(study))
    page = StoryPage(
        title="concealed-physics",
        sentence=sentence(study, goals),
        rows=[Measure(g.measure, g.demanded, g.reached, g.met) for g in goals if g.met is not None],
        notes=notes(
            __package__,
            seal=store.seal.hash,
            far=FAR,
            heavier=sum(case.heavier for case in advised),
            advised=len(advised),
            median=np.median(seconds),
            most=seconds.max(),
        ),
        figures=drawings(study),
        tables=[reported(goals), *tables(study)],
    )
    write_story(folder, page, record)
    result = {
        "sentence": page.sentence,
        "seal": store.seal.hash,
        "goals": [asdict(goal) for goal in goals],
        "cases": len(study.cases),
        "failures": dict(study.failures),
    }
    return end_run(folder, record, page.title, result)
