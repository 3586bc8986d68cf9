"""How often the true structure of a NARX system is found: all methods on systems whose equations are known.

Each system is drawn a hundred times. A method is right if it keeps the true terms and no others; oracles that know the
truth set what can be expected at all. Stated uncertainty is tried by how often the 95 % intervals hold the true
parameters, by a noise sweep, and by a sampler of structures.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from deatwin.scenarios.svb_benchmark.page import drawings, judge, tables
from deatwin.scenarios.svb_benchmark.study import CASES, SWEPT, Plan, carry_out
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.tables import csv_text
from deatwin.studies.report.words import notes
from deatwin.studies.stories import Setting

PLAN = Plan()


def run(setting: Setting) -> Mapping[str, Any]:
    """Draw data sets, identify them with all methods, and count how often the structure is found."""
    record, folder = setting.record(), setting.folder
    folder.written.extend(("seal.json", CASES))  # draws are there as soon as they are through
    study = carry_out(folder.path, setting.seed, PLAN, jobs=setting.jobs, tell=setting.progress)
    trials = [(t.system, t.method, t.number, t.redraws, t.missed, t.false, " + ".join(t.terms)) for t in study.trials]
    folder.text("trials.csv", csv_text(("system", "method", "draw", "redraws", "missed", "false", "terms"), trials))
    times = [(t.system, t.method, t.number, f"{t.seconds:.4f}") for t in study.trials]
    folder.text("times.csv", csv_text(("system", "method", "draw", "time_s"), times))  # differs between equal runs
    rows, swept = judge(study), study.contrasts.get(SWEPT, ())
    page = StoryPage(
        title="svb-benchmark",
        sentence=f"{len(PLAN.methods)} methods chose the structure in {PLAN.draws} draws of each of "
        f"{len(PLAN.systems)} systems; {reached(rows)} stated goals are reached.",
        rows=rows,
        notes=notes(
            __package__,
            swept=SWEPT,
            draws=len(swept),
            redraws=sum(draw.redraws for draw in swept),
            snr_db=np.median([draw.snr_db for draw in swept]) if swept else None,
        ),
        figures=drawings(study),
        tables=tables(study),
    )
    return finish(folder, record, page)
