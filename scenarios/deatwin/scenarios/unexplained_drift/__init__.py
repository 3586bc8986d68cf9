"""The fleet, its drifts concealed: what the diagnosis makes of the recordings, and what repeatability proves.

Six actuators of one specification are recorded; the diagnosis is given the specification and the recordings. What
drifts in each is hashed before and opened afterwards. Then the thesis' argument, that repeatability rules out creep
and relaxation (section 2.3.2), is tried out on actuators of which the mechanism is known.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from deatwin.ident.drifts import moving_mean
from deatwin.ident.mismatch.certainty import percent
from deatwin.plant import fleet
from deatwin.plant.drawing import Axes
from deatwin.plant.words import spaced
from deatwin.scenarios.unexplained_drift.repeatability import numbers, rows_of, sentence_of, table_of
from deatwin.scenarios.unexplained_drift.score import Judged, Mark, judged, measures
from deatwin.scenarios.unexplained_drift.sealed import Key, opened
from deatwin.scenarios.unexplained_drift.study import CASES, VISITS, Answers, Finding, Track, carry_out
from deatwin.studies.parallel import between
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above
from deatwin.studies.report.quantities import quantity, with_interval
from deatwin.studies.report.story import StoryPage, Table, end_run, write_story
from deatwin.studies.report.words import Words, notes
from deatwin.studies.stories import Setting

WORDS = Words(__package__)
WINDOW = 2.0  # Window of the sliding mean, s: two periods of the highest frequency of the input
KEPT = 10  # One point in so many is drawn


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
    counts = {mark: count for mark in Mark if (count := sum(score.mark is mark for score in scores))}
    marks = [f"{count} {mark.value}" for mark, count in counts.items()]
    (_, first), (again, second) = VISITS
    page = StoryPage(
        title="unexplained-drift",
        sentence=f"{WORDS.text('sentence', marks=', '.join(marks))} {sentence_of(groups)}",
        rows=[*measures(scores), *rows_of(groups)],
        notes=notes(
            __package__,
            first=first,
            second=second,
            again=again,
            key=answers.seal.parts["key"],
            marks=list(counts),
            **numbers(groups),
        ),
        figures=[_drifts(study.findings, scores)],
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


def _drifts(findings: Sequence[Finding], scores: Sequence[Judged]) -> Drawing:
    """Draw each actuator's departure from its calibrated base plant, as recorded and as the answer has it."""
    visits = len(findings[0].tracks)
    with draw((9.6, 1.75 * len(findings) + 0.6)) as figure:
        grid = figure.subplots(len(findings), visits, sharey="row", width_ratios=[2, 1][:visits], squeeze=False)
        for row, finding, score in zip(grid, findings, scores, strict=True):
            for axes, track in zip(row, finding.tracks, strict=True):
                _draw_departures(axes, track)
            row[0].set_title(_title(score), loc="left", fontsize=9.5)
            row[0].set_ylabel("departure (µm)")
        for axes in grid[-1]:
            axes.set_xlabel("clock (s)")
        legend_above(figure, grid[0, 0], 3)
        return WORDS.drawing(figure, "drifts", window=WINDOW)


def _draw_departures(axes: Axes, track: Track) -> None:
    samples = round(WINDOW / (track.timepts[1] - track.timepts[0]))
    slow = [moving_mean(values, samples) for values in (track.measured - track.base, track.answer - track.base)]
    kept = np.flatnonzero(np.isfinite(slow[0]))[::KEPT]
    measured, answer = (1e6 * values[kept] for values in slow)
    time, band = track.timepts[kept], 1.96e6 * track.deviation[kept]
    axes.axhline(0.0, color=Hue.BEFORE, label="calibrated base plant")
    axes.fill_between(time, answer - band, answer + band, color=Hue.AFTER, alpha=0.2, linewidth=0)
    axes.plot(time, measured, color=Hue.MEASURED, linewidth=2.0, label="recording")
    axes.plot(time, answer, color=Hue.AFTER, label="answer")


def _title(score: Judged) -> str:
    truth = spaced(" and ".join(score.truth))
    causes = spaced(" and ".join(c.effect for c in score.diagnosis.causes))
    answer = f"{spaced(score.diagnosis.verdict.value)}{': ' if causes else ''}{causes}"
    return f"{score.name}, with {truth}. Answer: {answer} ({score.mark.value})"


def _answers(scores: Sequence[Judged]) -> Table:
    rows = []
    for score in scores:
        found, unseen = score.diagnosis, score.diagnosis.fit.unseen
        causes = _words(f"{c.effect} ({percent(c.probability)})" for c in found.causes) or "–"
        errors = ["–" if error is None else f"{error:.2f}" for error in (unseen.before, unseen.after)]
        told = [_words(score.truth), _words([found.verdict.value]), causes, _words(found.names) or "–"]
        rows.append([score.name, *told, *errors, score.mark.value])
    return WORDS.table("answers", rows)


def _estimates(scores: Sequence[Judged]) -> Table:
    rows = []
    for score, e in [(each, estimate) for each in scores for estimate in each.estimates]:
        truth, found = quantity(e.truth, e.unit), with_interval(e.value, e.low, e.high, e.unit)
        rows.append([score.name, _words([e.effect]), _words([e.name]), truth, *found, "yes" if e.covered else "no"])
    return WORDS.table("estimates", rows)


def _words(names: Iterable[str]) -> str:
    return spaced(", ".join(names))
