"""The figures of the study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.scenarios.concealed_physics.results import Case, Opened
from deatwin.scenarios.concealed_physics.tables import MADE_BY, Confusion, by_effect, by_family, over_oracle
from deatwin.studies.calibration import brier_score, expected_calibration_error, reliability
from deatwin.studies.rates import Rate
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, titled
from deatwin.studies.report.svg import draw, standalone
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORDS = Words(__package__)
RUNGS = (0.0, 0.15, 0.39, 0.67, 1.2, 2.1, 3.7, np.inf)
"""Ends of the classes of structural residual over noise, halfway between the strengths of the cases."""
ANSWERS: dict[str, tuple[Callable[[Case], bool], str, str]] = {
    "detected": (lambda c: c.detected, Hue.MEASURED, "s"),
    "truth in the answer": (lambda c: c.inside, Hue.MARK, "D"),
    "first cause right": (lambda c: c.first_right, Hue.AFTER, "o"),
    "confident wrong name": (lambda c: c.confidently_wrong, Hue.BEFORE, "X"),
}


SIZE = (10.4, 8.6)


def drawings(study: Opened) -> list[Drawing]:
    """Draw the figures of the page."""
    with draw(SIZE) as figure:
        _whole(figure, study)
        whole = WORDS.drawing(figure, "summary")
    return [whole, _mechanisms(study)]


def summary(study: Opened) -> str:
    """Draw the study in one self-contained figure."""
    with draw(SIZE) as figure:
        _whole(figure, study)
        return standalone(figure)


def _whole(figure: Figure, study: Opened) -> None:
    """Draw confusion of families, power, reliability, and errors on held-out data."""
    (first, second), (third, fourth) = figure.subplots(2, 2)
    _draw_confusion(first, by_family(study), "small")
    _draw_power(second, study)
    _draw_reliability(third, study)
    _draw_errors(fourth, study)
    titles = {
        first: "concealed (rows), found (columns)",
        second: "one effect, by its strength",
        third: "stated probability of a cause",
        fourth: "free run on held-out data",
    }
    for axes, title in titles.items():
        titled(axes, title)


# --- confusion ------------------------------------------------------------------------------------------------------


def _mechanisms(study: Opened) -> Drawing:
    table = by_effect(study)
    with draw((11.0, 9.6)) as figure:
        _draw_confusion(figure.add_subplot(), table, "x-small")
        return WORDS.drawing(figure, "confusion_effect", table.csv())


def _draw_confusion(axes: Axes, table: Confusion, size: str) -> None:
    """Write counts into cells whose shade is the share of their row."""
    from matplotlib.patches import Rectangle

    causes, crowded = len(table.answers) - 3, len(table.answers) > 12
    for (row, column), count in np.ndenumerate(table.counts):
        if count:
            colour = Hue.AFTER if table.right[row, column] else Hue.BEFORE if column < causes else Hue.MEASURED
            depth = 0.15 + 0.6 * (count / table.counts[row].sum())
            axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, color=colour, alpha=depth, linewidth=0))
            axes.text(column, row, str(count), ha="center", va="center", fontsize=size)
    axes.axvline(causes - 0.5, color=Hue.INK, linewidth=0.8)
    axes.axhline(len(table.truths) - 2.5, color=Hue.INK, linewidth=0.8)
    axes.set_xticks(range(len(table.answers)), [a.replace("_", " ") for a in table.answers], fontsize=size)
    axes.tick_params(axis="x", labelrotation=90 if crowded else 40)
    for label in axes.get_xticklabels():
        label.set_horizontalalignment("center" if crowded else "right")
    axes.set_yticks(range(len(table.truths)), [t.replace("_", " ") for t in table.truths], fontsize=size)
    axes.set(xlim=(-0.5, len(table.answers) - 0.5), ylim=(len(table.truths) - 0.5, -0.5))
    axes.set_axisbelow(True)
    axes.grid(alpha=0.5)


# --- power ----------------------------------------------------------------------------------------------------------


def _draw_power(axes: Axes, study: Opened) -> None:
    for place, (words, (flag, colour, marker)) in enumerate(ANSWERS.items()):
        points = _classes(study.of("effect"), flag)
        shares = np.array([100 * r.share for _, r in points])
        ends = np.array([[100 * end for end in r.interval] for _, r in points]).reshape(-1, 2).T
        axes.errorbar(
            [x * 1.03**place for x, _ in points],
            shares,
            np.abs(ends - shares) if points else None,
            color=colour,
            label=words,
            fmt=f"{marker}-",
            markersize=4.5,
            capsize=2,
            elinewidth=0.8,
        )
    axes.set(xscale="log", xlabel="structural residual over noise", ylabel="cases (%)", ylim=(-4, 104))
    _plain_ratios(axes)


def _classes(cases: Sequence[Case], flag: Callable[[Case], bool]) -> list[tuple[float, Rate]]:
    """Return the geometric mean of the ratios, and the rate, of each class with any case."""
    made = []
    for low, high in pairwise(RUNGS):
        inside = [case for case in cases if low <= case.ratio < high]
        if inside:
            middle = float(np.exp(np.mean(np.log([max(c.ratio, 0.02) for c in inside]))))
            made.append((middle, Rate.of(flag(case) for case in inside)))
    return made


def _plain_ratios(axes: Axes) -> None:
    """Label the ratios, and put the legend below the axes."""
    ticks = [t for t in (0.03, 0.1, 0.3, 0.5, 1, 2, 5) if axes.get_xlim()[0] <= t <= axes.get_xlim()[1]]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.legend(loc="upper left", bbox_to_anchor=(-0.02, -0.14), ncols=2, markerscale=1, fontsize="small")


# --- reliability ----------------------------------------------------------------------------------------------------


def _draw_reliability(axes: Axes, study: Opened) -> None:
    stated = [pair for case in study.cases for pair in case.stated]
    bins = reliability(stated)
    axes.plot([0, 100], [0, 100], ":", color=Hue.INK, linewidth=0.9)
    for b in bins:
        place, share = 100 * b.stated, 100 * b.came_true.share
        axes.plot([place] * 2, [100 * end for end in b.came_true.interval], color=Hue.AFTER, linewidth=1.0, alpha=0.7)
        axes.plot(place, share, "o", color=Hue.AFTER, markersize=5)
        beside: dict[str, Any] = {"xytext": (-6, -3), "textcoords": "offset points", "ha": "right", "fontsize": "small"}
        axes.annotate(str(b.came_true.count), (place, share), **beside)
    label = "stated (%)"
    if stated:
        error, brier = expected_calibration_error(bins), brier_score(stated)
        label += f"\ncalibration error {error:.3f}, Brier score {brier:.3f}"
    axes.set(xlabel=label, ylabel="right (%)", xlim=(-3, 103), ylim=(-3, 103))


# --- errors on held-out data ------------------------------------------------------------------------------------------


def _draw_errors(axes: Axes, study: Opened) -> None:
    found, bottom, top = over_oracle(study), 1.0, 2.0
    shown = [name for name in MADE_BY if name != "oracle"]
    for place, name in enumerate(shown):
        if name not in found:
            continue
        ratios = found[name]
        low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
        bottom, top = min(bottom, float(ratios.min())), max(top, float(ratios.max()))
        colour = Hue.AFTER if name == "diagnosis" else Hue.BEFORE if name == "base" else Hue.MEASURED
        axes.plot([low, high], [place, place], color=colour, linewidth=5, alpha=0.3, solid_capstyle="butt")
        axes.plot(ratios, np.full(ratios.size, place + 0.2), "|", color=colour, markersize=5, alpha=0.6)
        axes.plot(middle, place, "o", color=colour, markersize=6)
        above: dict[str, Any] = {"xytext": (0, 7), "textcoords": "offset points", "ha": "center", "fontsize": "small"}
        axes.annotate(f"{middle:.2f}", (middle, place), **above)
    axes.axvline(1.0, color=Hue.INK, linestyle=":", linewidth=0.9)
    axes.set_xscale("log")
    ticks = [t for t in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if bottom / 1.3 <= t <= 1.3 * top]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_yticks(range(len(shown)), [MADE_BY[name].replace(" (", "\n(") for name in shown])
    axes.set(xlabel="error over the oracle's", ylim=(len(shown) - 0.4, -0.6))
    axes.grid(axis="y", visible=False)
