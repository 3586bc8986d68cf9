"""The fleet, its drifts concealed: what the diagnosis makes of the recordings, and what repeatability proves.

Six actuators of one specification are recorded; the diagnosis is given the specification and the recordings. What
drifts in each is hashed before and opened afterwards. Then the thesis' argument, that repeatability rules out creep
and relaxation (section 2.3.2), is tried out on actuators of which the mechanism is known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from deatwin.plant import fleet
from deatwin.scenarios.unexplained_drift.figures import drifts
from deatwin.scenarios.unexplained_drift.repeatability import numbers, rows_of, sentence_of, table_of
from deatwin.scenarios.unexplained_drift.score import Estimate, Judged, Mark, judged, measures
from deatwin.scenarios.unexplained_drift.sealed import Key, opened
from deatwin.scenarios.unexplained_drift.study import CASES, VISITS, Answers, carry_out
from deatwin.studies.parallel import between
from deatwin.studies.report.prose import notes
from deatwin.studies.report.quantities import quantity, with_interval
from deatwin.studies.report.story import StoryPage, Table, end_run, write_story
from deatwin.studies.stories import Setting


def run(setting: Setting) -> Mapping[str, Any]:
    """Seal the key, record and diagnose the actuators, test the argument, then open the key and count."""
    record, folder = setting.record(), setting.folder
    folder.written.extend(("seal.json", CASES))  # cases are there as soon as they are through
    answers = Answers(folder.path, Key.of(fleet(setting.seed)).seal(setting.seed))
    told = between(setting.progress, 0.0, 0.95)
    study = carry_out(answers, setting.seed, setting.command, setting.jobs, told)
    folder.written.extend(study.files)
    key = opened(folder.path, setting.seed)
    scores, groups = judged(study.findings, key), study.groups
    folder.text("key.json", json.dumps(key.drifts, indent=1) + "\n")
    setting.progress(0.95, "drawing")
    (_, first), (again, second) = VISITS
    page = StoryPage(
        title="unexplained-drift",
        sentence=f"{_said(scores)} {sentence_of(groups)}",
        rows=[*measures(scores), *rows_of(groups)],
        notes=notes(
            __package__,
            first=first,
            second=second,
            again=again,
            key=answers.seal.parts["key"],
            marks=[mark for mark in Mark if any(score.mark is mark for score in scores)],
            **numbers(groups),
        ),
        figures=[drifts(study.findings, scores)],
        tables=[_answers(scores), _estimates(scores), table_of(groups)],
    )
    write_story(folder, page, record)
    result = {
        "sentence": page.sentence,
        "seal": answers.seal.to_dict(),
        "answers": [score.to_dict() for score in scores],
        "measures": [asdict(row) for row in page.rows],
        "repeatability": [group.to_dict() for group in groups],
    }
    return end_run(folder, record, page.title, result)


def _said(scores: Sequence[Judged]) -> str:
    counts = {mark: sum(score.mark is mark for score in scores) for mark in Mark}
    told = [f"{count} {mark.value}" for mark, count in counts.items() if count]
    return f"Results for the six actuators with concealed drifts: {', '.join(told)}."


def _answers(scores: Sequence[Judged]) -> Table:
    def unseen(score: Judged, when: str) -> str:
        error = getattr(score.diagnosis.fit.unseen, when)
        return "–" if error is None else f"{error:.2f}"

    return Table.of(
        "The answers",
        scores,
        {
            "actuator": lambda score: score.name,
            "concealed": lambda score: _words(score.truth),
            "verdict": lambda score: _words([score.diagnosis.verdict.value]),
            "causes (probability)": lambda score: (
                _words(f"{c.effect} ({c.probability:.2f})" for c in score.diagnosis.causes) or "–"
            ),
            "set": lambda score: _words(score.diagnosis.names) or "–",
            "held out, before (µm)": lambda score: unseen(score, "before"),
            "after (µm)": lambda score: unseen(score, "after"),
            "mark": lambda score: score.mark.value,
        },
    )


def _estimates(scores: Sequence[Judged]) -> Table:
    def found(e: Estimate) -> tuple[str, str]:
        return with_interval(e.value, e.low, e.high, e.unit)

    columns: dict[str, Callable[[tuple[Judged, Estimate]], object]] = {
        "actuator": lambda row: row[0].name,
        "effect": lambda row: _words([row[1].effect]),
        "parameter": lambda row: _words([row[1].name]),
        "truth": lambda row: quantity(row[1].truth, row[1].unit),
        "found": lambda row: found(row[1])[0],
        "95 % interval": lambda row: found(row[1])[1],
        "covered": lambda row: "yes" if row[1].covered else "no",
    }
    rows = [(score, estimate) for score in scores for estimate in score.estimates]
    return Table.of("Parameters of the causes that are present", rows, columns)


def _words(names: Iterable[str]) -> str:
    return ", ".join(names).replace("_", " ")
