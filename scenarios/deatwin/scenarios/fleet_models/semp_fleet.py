"""Six actuators identified as in chapter 4: SEMP, held against FROLS, validated, and what of it the drifts undo.

The recordings are those of the story `thesis-data`. Each is inspected, a stationary stretch is taken and its end held
out; sampling time, lags and degree are chosen by free-run error on the training sections; SEMP chooses terms, and the
held-out sections say what the models are worth. What a model fails at is shown, and held against the same actuator
without its drift, and without its hysteresis, under the same commands and the same noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.page import failures, judge_semp, semp_drawings, semp_tables
from deatwin.scenarios.fleet_models.study import FROLS, SEMP, Programme, Study, carry_out, save
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import StoryPage, reached
from deatwin.studies.report.words import Span, notes
from deatwin.studies.stories import Setting

PROGRAMME = Programme(methods=(SEMP,), beside=(FROLS,))


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify the fleet by SEMP."""
    record = setting.record()
    study = carry_out(setting.seed, PROGRAMME, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.9, "judging and drawing")
    rows = judge_semp(study)
    fits = Span(bench.models[SEMP].fit for bench in study.recorded)
    page = StoryPage(
        title="semp-fleet",
        sentence=WORDS.text("semp", fits=fits, reached=reached(rows)),
        rows=rows,
        notes=notes(__package__, method=SEMP, **failures(study), **_choices(study)),
        figures=semp_drawings(study),
        tables=semp_tables(study),
    )
    return save(setting, record, page, study, SEMP)


def _choices(study: Study) -> dict[str, Any]:
    """Choices on the training sections, and errors on the held-out ones, in words."""
    plan, step = study.plan, study.sample_time
    asked = sorted({one.sampling.factor * step for one in study.prepared})
    tried = [f"{100 * one.least.mean():.1f} % at {quantity(one.factor * step, 's')}" for one in plan.orders]
    errors = [
        (bench.name, *(1e6 * float(bench.models[method].held_out.free_run.rms[0]) for method in (SEMP, FROLS)))
        for bench in study.recorded
    ]
    return {
        "asked": " or ".join(quantity(time, "s") for time in asked),
        "tried": ", ".join(tried),
        "errors": ", ".join(f"{name} {semp:.1f} µm against {fro:.1f} µm" for name, semp, fro in errors),
    }
