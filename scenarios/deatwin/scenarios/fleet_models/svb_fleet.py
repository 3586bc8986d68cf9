"""Six actuators identified as in chapter 6: sparse variational Bayes with its posteriors, beside SEMP.

Recordings, sections, sampling time and candidates are those of the story `semp-fleet`. SVB prunes the candidates and
keeps the step of the largest lower bound; SEMP stands beside it on the same sections. The posterior gives intervals of
the parameters and bands of the readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.ident.narx import Frols
from deatwin.ident.narx.fleet.orders import RULE
from deatwin.scenarios.fleet_models.choice import Choice, compare
from deatwin.scenarios.fleet_models.notes import svb_notes
from deatwin.scenarios.fleet_models.study import FREE, SEMP, SVB, Programme, Study
from deatwin.scenarios.fleet_models.svb_figures import svb_drawings
from deatwin.scenarios.fleet_models.tables import SHOWN, svb_tables
from deatwin.scenarios.fleet_models.telling import Account, tell
from deatwin.scenarios.fleet_models.verdicts import judge_svb
from deatwin.studies.report.story import StoryPage
from deatwin.studies.stories import Setting

PROGRAMME = Programme(methods=(SEMP, SVB), beside=(FREE,))
LONGEST_PATH = 40
"""Of FRO, in terms, where it is held against SVB."""


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify the fleet by SVB, and by SEMP to compare it with."""
    return tell(setting, PROGRAMME, SVB, _account)


def _account(setting: Setting, study: Study) -> Account:
    rows = judge_svb(study)
    own, other = ([bench.models[method].fit for bench in study.recorded] for method in (SVB, SEMP))
    figures, files = svb_drawings(study, _choice(study), setting.seed)
    page = StoryPage(
        title="svb-fleet",
        sentence=(
            f"Six actuators by sparse variational Bayes: over sections that nothing was fitted to, the free runs fit "
            f"{min(own):.0f} to {max(own):.0f} %, those of SEMP {min(other):.0f} to {max(other):.0f} %; "
            f"{sum(row.passed for row in rows)} of {len(rows)} stated measures are reached."
        ),
        rows=rows,
        notes=svb_notes(study),
        figures=figures,
        tables=svb_tables(study),
    )
    return page, files


def _choice(study: Study) -> Choice:
    """Follow the paths of SVB and FRO on the actuator that is shown in full."""
    bench, plan = study.recorded[SHOWN - 1], study.plan
    fro = Frols(
        output_lags=plan.output_lags,
        input_lags=plan.input_lags,
        degree=plan.degree,
        rule=RULE,
        max_terms=LONGEST_PATH,
        criterion="none",
    )
    return compare(bench.models[SVB].search, fro.fit(bench.sections[0]), *bench.sections)
