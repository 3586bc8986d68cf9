"""Figures of what was predicted: numbers of five models, and verdicts on random rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from deatwin.control.checking.specification import Verdict
from deatwin.scenarios.control_check.matters import Matters
from deatwin.scenarios.control_check.promises import QUANTITIES, promises
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tables import trials_csv, verdicts_seen
from deatwin.scenarios.control_check.trials import Outcome
from deatwin.scenarios.svb_benchmark.figures import table_text
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


INK, GREY, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
TRUTHS: dict[bool | None, str] = {True: "sound", False: "not sound", None: "no controller"}
"""What the true rig said."""
MARKS: dict[bool | None, tuple[str, str]] = {True: (AFTER, "o"), False: (BEFORE, "X"), None: (GREY, "s")}
JITTER = 0.28
"""Of a row of the verdicts, so that trials do not lie upon each other."""


def check_drawings(study: Study) -> list[tuple[Drawing, str]]:
    """Draw what was predicted, and what came."""
    return [_models(study.matters), _trials(study.outcomes)]


def _models(matters: Matters) -> tuple[Drawing, str]:
    """Interval and achieved number, a panel for each quantity."""
    made = promises(matters)
    names = [matter.name for matter in matters.models]
    with draw((9.6, 3.4)) as figure:
        panels = figure.subplots(1, len(QUANTITIES), sharey=True)
        for axes, quantity in zip(panels, QUANTITIES, strict=True):
            for promise in (p for p in made if p.quantity is quantity):
                row, p = names.index(promise.model), promise.predicted
                axes.plot([p.low, p.high], [row, row], color=AFTER, linewidth=5, alpha=0.4, solid_capstyle="butt")
                axes.plot(p.value, row, "|", color=AFTER, markersize=10, markeredgewidth=2)
                axes.plot(promise.achieved, row, "D", color=INK if promise.kept else BEFORE, markersize=5)
            axes.set(xscale="log", xlabel=quantity.label)
            _decades(axes)
            axes.margins(x=0.12)
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.5, -0.5)
        figure.legend(handles=_handles(), loc="outside upper left", ncols=3, markerscale=1)
        drawing = Drawing.of(
            figure,
            "models",
            "Does the model matter? What each promised, and what it got",
            "One design rule on five models of one actuator, each judged on the true plant. Bandwidth and gain margin "
            "are promised by the linearised model and measured with sines as large as the steps; overshoot and error "
            "are of the steps, promised by closed loops on draws of the model with the residual of its free run.",
        )
    header = ("model", "quantity", "predicted", "low", "high", "achieved", "inside")
    rows = [
        (
            p.model,
            p.quantity.column,
            *(f"{v:.5g}" for v in (p.predicted.value, p.predicted.low, p.predicted.high)),
            f"{p.achieved:.5g}",
            int(p.kept),
        )
        for p in made
    ]
    return drawing, table_text(header, rows)


def _handles() -> list[object]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=AFTER, linewidth=5, alpha=0.4, label="predicted, 95 % interval"),
        Line2D([], [], linestyle="", marker="D", color=INK, markersize=5, label="achieved, inside"),
        Line2D([], [], linestyle="", marker="D", color=BEFORE, markersize=5, label="achieved, outside"),
    ]


def _decades(axes: Axes) -> None:
    """1, 10 and 100 instead of powers, and 2 and 5 of each where the axis is short."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 50 else (1.0,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _trials(outcomes: Sequence[Outcome]) -> tuple[Drawing, str]:
    verdicts = verdicts_seen(outcomes)
    with draw((9.6, 3.8)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.9))
        _draw_confusion(left, outcomes, verdicts)
        _draw_times(right, outcomes, verdicts)
        legend_above(figure, right, 4)
        drawing = Drawing.of(
            figure,
            "trials",
            "Did the verdict keep its word?",
            "Random rigs, most with physics that their specification does not have, random designs. Sound: the true "
            "rig keeps every limit of the check. Left: numbers of trials; blue is a verdict that was right, orange a "
            "passed design that was not sound, grey caution. Right: hollow marks left the predicted band.",
        )
    return drawing, trials_csv(outcomes)


def _draw_confusion(axes: Axes, outcomes: Sequence[Outcome], verdicts: Sequence[str]) -> None:
    from matplotlib.patches import Rectangle

    truths = [truth for truth in TRUTHS if truth is not None or any(o.sound is None for o in outcomes)]
    for row, verdict in enumerate(verdicts):
        for column, truth in enumerate(truths):
            count = sum(o.verdict == verdict and o.sound is truth for o in outcomes)
            if count:
                colour = _colour(verdict == Verdict.PASS.value, truth)
                depth = 0.2 + 0.5 * count / len(outcomes)
                axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, color=colour, alpha=depth, linewidth=0))
            axes.text(column, row, str(count), ha="center", va="center")
    axes.set_xticks(range(len(truths)), [TRUTHS[truth] for truth in truths])
    axes.set_yticks(range(len(verdicts)), verdicts)
    axes.set(
        xlim=(-0.5, len(truths) - 0.5),
        ylim=(len(verdicts) - 0.5, -0.5),
        xlabel="on the true rig",
        ylabel="verdict of the check",
    )
    axes.grid(False)


def _colour(passed: bool, truth: bool | None) -> str:
    if truth is None or (truth and not passed):
        return GREY
    return AFTER if passed is truth else BEFORE


def _draw_times(axes: Axes, outcomes: Sequence[Outcome], verdicts: Sequence[str]) -> None:
    places = np.random.default_rng(0).uniform(-JITTER, JITTER, len(outcomes))
    labelled: set[bool | None] = set()
    for outcome, place in zip(outcomes, places, strict=True):
        colour, marker = MARKS[outcome.sound]
        hollow = outcome.inside is not None and outcome.inside < 1.0
        axes.plot(
            outcome.closed_loop_time,
            verdicts.index(outcome.verdict) + place,
            marker,
            color=colour,
            markersize=6,
            markerfacecolor="none" if hollow else colour,
            label="_",
            linestyle="",
        )
        labelled.add(outcome.sound)
    for truth in (truth for truth in TRUTHS if truth in labelled):
        colour, marker = MARKS[truth]
        axes.plot([], [], marker, color=colour, markersize=6, linestyle="", label=TRUTHS[truth])
    axes.set(xscale="log", xlabel="closed-loop time asked for (s)", ylim=(len(verdicts) - 0.5, -0.5))
    axes.set_yticks(range(len(verdicts)), verdicts)
    _decades(axes)
    axes.grid(axis="y", visible=False)
    for edge in range(1, len(verdicts)):
        axes.axhline(edge - 0.5, color=COLOURS["grid"][0], linewidth=0.8)
