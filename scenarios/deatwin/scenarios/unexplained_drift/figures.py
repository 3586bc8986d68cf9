"""The figures: what drifts, what the diagnosis made of it, and what repeats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import moving_mean
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
    visits = len(findings[0].tracks)
    with draw((9.6, 1.75 * len(findings) + 0.6)) as figure:
        grid = figure.subplots(len(findings), visits, sharey="row", width_ratios=[2, 1][:visits], squeeze=False)
        for row, finding, score in zip(grid, findings, scores, strict=True):
            for axes, track in zip(row, finding.tracks, strict=True):
                _draw_departures(axes, *_departures(track))
            row[0].set_title(_title(score), loc="left", fontsize=9.5)
            row[0].set_ylabel("departure (µm)")
        for axes in grid[-1]:
            axes.set_xlabel("clock (s)")
        legend_above(figure, grid[0, 0], 3)
        return WORDS.drawing(figure, "drifts", window=WINDOW)


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
