"""Six actuators identified as in chapter 6: sparse variational Bayes with its posteriors, beside SEMP.

Recordings, sections, sampling time and candidates are those of the story `semp-fleet`. SVB prunes the candidates and
keeps the step of the largest lower bound; SEMP stands beside it on the same sections. The posterior gives intervals of
the parameters and bands of the readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.ident.narx import Frols
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.page import compare, failures, judge_svb, svb_drawings, svb_tables
from deatwin.scenarios.fleet_models.study import FREE, SEMP, SVB, Programme, Study, candidates, carry_out, save
from deatwin.studies.report.story import StoryPage, reached
from deatwin.studies.report.words import Span, notes
from deatwin.studies.stories import Setting

PROGRAMME = Programme(methods=(SEMP, SVB), beside=(FREE,))
LONGEST_PATH = 40  # Terms of the path of FROLS that is held against SVB


def run(setting: Setting) -> Mapping[str, Any]:
    """Identify the fleet by SVB, and by SEMP to compare it with."""
    record = setting.record()
    study = carry_out(setting.seed, PROGRAMME, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.9, "judging and drawing")
    rows, shown = judge_svb(study), study.shown
    fro = Frols(**candidates(study.plan), max_terms=LONGEST_PATH, criterion="none").fit(shown.sections[0])
    choice = compare(shown.models[SVB].search, fro, *shown.sections)
    own, other = (Span(bench.models[method].fit for bench in study.recorded) for method in (SVB, SEMP))
    page = StoryPage(
        title="svb-fleet",
        sentence=WORDS.text("svb", own=own, other=other, reached=reached(rows)),
        rows=rows,
        notes=notes(__package__, method=SVB, **failures(study), **_kept(study)),
        figures=svb_drawings(study, choice),
        tables=svb_tables(study),
    )
    return save(setting, record, page, study, SVB)


def _kept(study: Study) -> dict[str, Any]:
    """Terms that SVB keeps, and its fits with more candidates."""
    free = [bench.models[FREE] for bench in study.recorded]
    counts = {m: ", ".join(str(len(bench.models[m].model.terms)) for bench in study.recorded) for m in study.methods}
    return {
        "counts": "; ".join(f"{method} {numbers}" for method, numbers in counts.items()),
        "lost": sum(bool(one.training.diverged or one.held_out.diverged) for one in free),
        "free": Span(one.fit for one in free if not one.held_out.diverged),
        "kept": Span(bench.models[SVB].fit for bench in study.recorded),
    }
