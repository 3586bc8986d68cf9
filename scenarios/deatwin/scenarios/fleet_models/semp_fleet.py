"""Six actuators identified as in chapter 4: SEMP, held against FRO, validated, and what of it the drifts undo.

The recordings are those of the story `thesis-data`. Each is looked over, a stationary stretch is taken and its end
held out; sampling time, lags and degree are chosen by free-run error on the training sections; SEMP chooses terms, and
the held-out sections say what the models are worth. What a model fails at is shown, and held against the same actuator
without its drift, and without its hysteresis, under the same commands and the same noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.scenarios.fleet_models.estimators import estimate_all
from deatwin.scenarios.fleet_models.figures import semp_drawings
from deatwin.scenarios.fleet_models.notes import semp_notes
from deatwin.scenarios.fleet_models.study import FRO, SEMP, Programme, Study
from deatwin.scenarios.fleet_models.tables import SHOWN, semp_tables
from deatwin.scenarios.fleet_models.telling import Account, tell
from deatwin.scenarios.fleet_models.verdicts import judge_semp
from deatwin.studies.report.story import StoryPage
from deatwin.studies.stories import Setting

PROGRAMME = Programme(methods=(SEMP,), beside=(FRO,))


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify the fleet by SEMP."""
    return tell(setting, PROGRAMME, SEMP, _account)


def _account(_: Setting, study: Study) -> Account:
    rows = judge_semp(study)
    fits = [bench.models[SEMP].fit for bench in study.recorded]
    shown = study.recorded[SHOWN - 1]
    estimated = estimate_all(shown.models[SEMP].model.terms, *shown.sections)
    figures, files = semp_drawings(study, SHOWN)
    page = StoryPage(
        title="semp-fleet",
        sentence=(
            f"Six actuators by SEMP: over sections that nothing was fitted to, the free runs fit {min(fits):.0f} to "
            f"{max(fits):.0f} %; {sum(row.passed for row in rows)} of {len(rows)} stated measures are reached. What "
            "drift, hysteresis and the polynomials' own misfit leave is in the correlation tests."
        ),
        rows=rows,
        notes=semp_notes(study),
        figures=figures,
        tables=semp_tables(study, estimated),
    )
    return page, files
