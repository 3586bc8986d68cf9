"""The fleet, its drifts concealed: what the diagnosis makes of the recordings, and what repeatability proves.

Six actuators of one specification are recorded; the diagnosis is given the specification and the recordings. What
drifts in each is hashed before and opened afterwards. Then the thesis' argument, that repeatability rules out creep
and relaxation (section 2.3.2), is tried out on actuators of which the mechanism is known.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from deatwin.plant.fleet import fleet
from deatwin.scenarios.unexplained_drift import figures
from deatwin.scenarios.unexplained_drift.argument import notes, rows_of, sentence_of, table_of
from deatwin.scenarios.unexplained_drift.recordings import VISITS
from deatwin.scenarios.unexplained_drift.score import Judged, Mark, judged, measures
from deatwin.scenarios.unexplained_drift.sealed import Key, opened
from deatwin.scenarios.unexplained_drift.study import CASES, Answers, Study, carry_out
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.quantities import quantity, with_interval
from deatwin.studies.report.story import Note, StoryPage, Table, write_story
from deatwin.studies.stories import Setting
from deatwin.studies.sweep.seal import SweepSeal

__all__ = ["run"]


def run(setting: Setting) -> Mapping[str, Any]:
    """Seal, record, diagnose and try out the argument; then open and count."""
    record = setting.record()
    setting.folder.written.extend(("seal.json", CASES))  # cases are there as soon as they are through
    answers = Answers(setting.folder.path, Key.of(fleet(setting.seed)).seal(setting.seed))
    study = carry_out(
        answers, setting.seed, setting.command, setting.jobs, lambda share, text: setting.progress(0.95 * share, text)
    )
    setting.folder.written.extend(study.files)
    key = opened(setting.folder.path, setting.seed)
    scores = judged(study.findings, key)
    setting.folder.text("key.json", json.dumps(key.drifts, indent=1) + "\n")
    setting.progress(0.95, "drawing")
    return _written(setting, record, study, scores, answers.seal)


def _written(
    setting: Setting, record: RunRecord, study: Study, scores: Sequence[Judged], seal: SweepSeal
) -> Mapping[str, Any]:
    groups = study.groups
    sentence = f"{_said(scores)} {sentence_of(groups)}"
    drawn = [figures.drifts(study.findings, scores), figures.verdicts(scores), figures.repeats(groups)]
    for drawing, columns in drawn:
        setting.folder.csv(drawing.data, columns)
    rows = [*measures(scores), *rows_of(groups)]
    page = StoryPage(
        title="unexplained-drift",
        sentence=sentence,
        rows=rows,
        figures=[drawing for drawing, _ in drawn],
        notes=[_about(scores, seal), *notes(groups)],
        tables=[_answers(scores), _estimates(scores), table_of(groups)],
    )
    write_story(setting.folder, page, record)
    result = {
        "sentence": sentence,
        "seal": seal.to_dict(),
        "answers": [score.to_dict() for score in scores],
        "measures": [asdict(row) for row in rows],
        "repeatability": [group.to_dict() for group in groups],
    }
    setting.folder.text("unexplained-drift.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    finished = record.finished([*setting.folder.written, "run.json"])
    setting.folder.text("run.json", json.dumps(finished, indent=1) + "\n")
    return result


def _said(scores: Sequence[Judged]) -> str:
    counts = {mark: sum(score.mark is mark for score in scores) for mark in Mark}
    told = [f"{count} {mark.value}" for mark, count in counts.items() if count]
    return f"Of six concealed drifts the diagnosis has {', '.join(told)}."


def _about(scores: Sequence[Judged], seal: SweepSeal) -> Note:
    (_, first), (again, second) = VISITS
    marks = [mark for mark in Mark if any(score.mark is mark for score in scores)]
    return Note(
        title="What was known, and what was concealed",
        paragraphs=[
            f"Each actuator is driven with the thesis' noise for {first:g} s, rests at 0 V, and is driven for "
            f"{second:g} s more at {again:g} s of the clock. The thesis drove its six for 1100 s on end: two visits "
            "with a rest cost the diagnosis a ninth of the time, and tell what follows the drive, which starts anew, "
            "from what follows the clock, which goes on. The film is taken as recovered after the rest. What swings in "
            "between is not seen, so a period that fits both visits need not be the true one.",
            "The diagnosis is given these recordings and the specification: hysteresis and the chain of converters, "
            "amplifier and laser are in it, the permittivity's law of the thesis' plant is not, for that is a drift. "
            "It knows neither the fabrication (twelve quantities are off by up to 20 %) nor what drifts.",
            "Concealed drifts, the thresholds of the diagnosis and the code were hashed before the first. After the "
            "last the drifts were made anew from the seed, and the hashes are the same. Of the drifts: "
            f"{seal.parts['key']}.",
            "The first actuator also runs over a ridge of grease for 20 s, which no effect of the catalogue is; the "
            "answer is not asked for it.",
            *(f"“{mark.value}”: {mark.advice}." for mark in marks),
            "Each diagnosis step by step: diagnoses/dea1/report.html and so on.",
        ],
    )


def _answers(scores: Sequence[Judged]) -> Table:
    rows = []
    for score in scores:
        diagnosis, unseen = score.diagnosis, score.diagnosis.fit.unseen
        after = "–" if unseen.after is None else f"{unseen.after:.2f}"
        causes = ", ".join(f"{c.effect} ({c.probability:.2f})" for c in diagnosis.causes) or "–"
        rows.append(
            [
                score.name,
                _words(score.truth),
                diagnosis.verdict.value.replace("_", " "),
                _plain(causes),
                _words(diagnosis.names) or "–",
                f"{unseen.before:.2f}",
                after,
                score.mark.value,
            ]
        )
    return Table(
        title="The answers",
        rows=rows,
        columns=[
            "actuator",
            "concealed",
            "verdict",
            "causes (probability)",
            "set",
            "unseen, before (µm)",
            "after (µm)",
            "mark",
        ],
    )


def _estimates(scores: Sequence[Judged]) -> Table:
    rows = []
    for score in scores:
        for e in score.estimates:
            value, interval = with_interval(e.value, e.low, e.high, e.unit)
            rows.append(
                [
                    score.name,
                    _plain(e.effect),
                    _plain(e.name),
                    quantity(e.truth, e.unit),
                    value,
                    interval,
                    "yes" if e.covered else "no",
                ]
            )
    columns = ["actuator", "effect", "parameter", "truth", "found", "95 % interval", "covered"]
    return Table(title="Parameters of the causes that are there", columns=columns, rows=rows)


def _words(names: Sequence[str] | Mapping[str, Any]) -> str:
    return _plain(", ".join(names))


def _plain(name: str) -> str:
    return name.replace("_", " ")
