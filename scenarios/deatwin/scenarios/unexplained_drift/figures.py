"""The figures: what drifts, what the diagnosis made of it, and what repeats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import moving_mean
from deatwin.scenarios.unexplained_drift.repeatability import Group
from deatwin.scenarios.unexplained_drift.score import Judged
from deatwin.scenarios.unexplained_drift.study import Finding, Track
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes


WORDS = Words(__package__)
Array = NDArray[np.float64]
WINDOW = 2.0
"""Window of the sliding mean, s: two periods of the highest frequency of the input."""
KEPT = 10
"""One point in so many is drawn."""


def drifts(findings: Sequence[Finding], scores: Sequence[Judged]) -> Drawing:
    """Draw each actuator's departure from its calibrated base plant, as recorded and as the answer has it."""
    columns: dict[str, list[Array]] = {"actuator": [], "time_s": [], "recording_um": [], "answer_um": [], "band_um": []}
    visits = len(findings[0].tracks)
    with draw((9.6, 1.75 * len(findings) + 0.6)) as figure:
        grid = figure.subplots(len(findings), visits, sharey="row", width_ratios=[2, 1][:visits], squeeze=False)
        for number, (row, finding, score) in enumerate(zip(grid, findings, scores, strict=True), start=1):
            for axes, track in zip(row, finding.tracks, strict=True):
                time, measured, answer, band = _departures(track)
                _draw_departures(axes, time, measured, answer, band)
                shown = np.full(time.size, float(number)), time, measured, answer, band
                for column, values in zip(columns.values(), shown, strict=True):
                    column.append(values)
            row[0].set_title(_title(score), loc="left", fontsize=9.5)
            row[0].set_ylabel("departure (µm)")
        for axes in grid[-1]:
            axes.set_xlabel("clock (s)")
        legend_above(figure, grid[0, 0], 3)
        return WORDS.drawing(
            figure, "drifts", {name: np.concatenate(values) for name, values in columns.items()}, window=WINDOW
        )


def repeats(groups: Sequence[Group]) -> Drawing:
    """Draw shifts of the mean between two runs of the same noise, by mechanism and history."""
    columns: dict[str, list[float]] = {"group": [], "actuator": [], "shift_um": [], "error_um": [], "gain_percent": []}
    with draw((9.6, 4.6)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for place, group in enumerate(groups):
            colour = Hue.INK if place == 0 else Hue.AFTER
            spread = np.linspace(-0.2, 0.2, group.sizes.size)
            if place:
                left.barh(
                    place, 1e6 * np.diff(group.next_one)[0], 0.66, 1e6 * group.next_one[0], color=Hue.MARK, alpha=0.3
                )
            left.plot(1e6 * group.sizes, place + spread, "o", color=colour, markersize=4)
            right.plot([100 * d.gain for d in group.drifts], place + spread, "o", color=colour, markersize=4)
            for number, d in enumerate(group.drifts, start=1):
                found = (place, number, 1e6 * d.shift, 1e6 * d.shift_error, 100 * d.gain)
                for column, value in zip(columns.values(), found, strict=True):
                    column.append(float(value))
        left.set_yticks(range(len(groups)), [f"{g.name}:\n{g.assumption}" for g in groups])
        left.invert_yaxis()
        for axes, label in ((left, "shift of the mean (µm)"), (right, "change of the gain (%)")):
            axes.axvline(0.0, color=Hue.INK, linewidth=0.8)
            axes.set_xlabel(label)
        return WORDS.drawing(figure, "repeats", columns)


def _departures(track: Track) -> tuple[Array, Array, Array, Array]:
    samples = round(WINDOW / (track.timepts[1] - track.timepts[0]))
    slow = [moving_mean(values, samples) for values in (track.measured - track.base, track.answer - track.base)]
    kept = np.flatnonzero(np.isfinite(slow[0]))[::KEPT]
    measured, answer = (1e6 * values[kept] for values in slow)
    return track.timepts[kept], measured, answer, 1.96e6 * track.deviation[kept]


def _draw_departures(axes: Axes, time: Array, measured: Array, answer: Array, band: Array) -> None:
    axes.axhline(0.0, color=Hue.BEFORE, label="calibrated base plant")
    axes.fill_between(time, answer - band, answer + band, color=Hue.AFTER, alpha=0.2, linewidth=0)
    axes.plot(time, measured, color=Hue.MEASURED, linewidth=2.0, label="recording")
    axes.plot(time, answer, color=Hue.AFTER, label="answer")


def _title(score: Judged) -> str:
    truth = " and ".join(score.truth).replace("_", " ")
    causes = " and ".join(c.effect for c in score.diagnosis.causes).replace("_", " ")
    answer = f"{score.diagnosis.verdict.value.replace('_', ' ')}{': ' if causes else ''}{causes}"
    return f"{score.name}, with {truth}. Answer: {answer} ({score.mark.value})"
