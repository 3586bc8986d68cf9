"""The figures: closed loops, numbers of five models, and verdicts on random rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.specification import Verdict
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.scenarios.control_check.concealed import Concealed
from deatwin.scenarios.control_check.matters import QUANTITIES, Matters
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tables import MICRO, trials_csv, verdicts_seen
from deatwin.scenarios.control_check.tracking import SETTLED, FleetRun, Tracking
from deatwin.scenarios.control_check.trials import Outcome
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, filled, numbers_of_decades, titled
from deatwin.studies.report.svg import COLOURS, draw, legend_above
from deatwin.studies.report.tables import csv_text
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORDS = Words(__package__)
Array = NDArray[np.float64]
STYLES = ((Hue.AFTER, "-"), (Hue.BEFORE, "-"), (Hue.MARK, "-"), (Hue.MEASURED, "-"), (Hue.INK, "-"), (Hue.AFTER, "--"))
"""Colours and lines of the six actuators."""
STRETCH = 10.0
"""Length of the tones that is drawn, s."""
SHOWN = {
    "PI": (Hue.BEFORE, "-", "PI alone"),
    "inverse": (Hue.AFTER, "-", "PI behind the inverse"),
    "inverse with dynamics": (Hue.MARK, "-", "the same, with dynamics"),
    "oracle: inverse with dynamics": (Hue.INK, ":", "oracle, with dynamics"),
}
TRUTHS: dict[bool | None, str] = {True: "sound", False: "not sound", None: "no controller"}
"""Verdicts of the true rig."""
MARKS: dict[bool | None, tuple[str, str]] = {
    True: (Hue.AFTER, "o"),
    False: (Hue.BEFORE, "X"),
    None: (Hue.MEASURED, "s"),
}
JITTER = 0.28
"""Scatter within a row of the verdicts, so that trials do not lie upon each other."""


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    loops = [_tracking(study.tracking), _fleet(study.fleet), _concealed(study.concealed)]
    return [*loops, _models(study.matters), _trials(study.outcomes)]


# --- closed loops ---------------------------------------------------------------------------------------------------


def _tracking(every: Sequence[Tracking]) -> Drawing:
    """Errors on the tones over a stretch of time, all of them and the small ones; and their rms."""
    nominal = every[0]
    with draw((9.6, 5.2)) as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
        above = figure.add_subplot(grid[0, 0])
        below = figure.add_subplot(grid[1, 0], sharex=above)
        for axes, hidden in ((above, ()), (below, ("PI", "inverse"))):
            for name, (colour, line, label) in SHOWN.items():
                if name not in hidden:
                    run = nominal.tracked[name].run
                    part = slice(*np.searchsorted(run.timepts, (SETTLED, SETTLED + STRETCH)))
                    axes.plot(run.timepts[part], MICRO * run.error[part], line, color=colour, label=label)
            axes.set_ylabel("error (µm)")
        titled(above, f"{nominal.name}: all")
        titled(below, "the two smallest, enlarged")
        below.set_xlabel("time (s)")
        above.tick_params(labelbottom=False)
        _rms(figure.add_subplot(grid[:, 1]), every)
        legend_above(figure, above, 4)
        columns: dict[str, Array] = {}
        for tracking in every:
            longest = max((one.run for one in tracking.tracked.values()), key=lambda run: run.timepts.size)
            where = tracking.name.replace(" ", "_")
            columns |= {"time_s": longest.timepts, f"{where}_reference_um": MICRO * longest.reference}
            for name, one in tracking.tracked.items():
                key = name.replace(": ", "_").replace(" ", "_")
                columns[f"{where}_{key}_error_um"] = MICRO * one.run.error
        return WORDS.drawing(figure, "tracking", filled(columns), settled=SETTLED)


def _rms(axes: Axes, every: Sequence[Tracking]) -> None:
    """Draw bars from the lower end of a logarithmic axis."""
    names = list(every[0].tracked)
    height, largest = 0.8 / len(every), 0.0
    for place, tracking in enumerate(every):
        values = np.array([MICRO * tracking.tracked[name].rms for name in names])
        rows = np.arange(len(names)) + (place - 0.5 * (len(every) - 1)) * height
        shown = np.where(np.isfinite(values), values, 0.0)
        colour = (Hue.AFTER, Hue.MEASURED)[place % 2]
        axes.barh(rows, shown, height=0.92 * height, color=colour, alpha=0.8, label=tracking.name)
        for row, value in zip(rows, values, strict=True):
            text, end = (f"{value:.3g}", value) if np.isfinite(value) else ("failed", 0.1)
            beside: dict[str, Any] = {
                "xytext": (3, 0),
                "textcoords": "offset points",
                "va": "center",
                "fontsize": "small",
            }
            axes.annotate(text, (end, row), **beside)
        largest = max(largest, float(shown.max()))
    axes.set(xscale="log", xlim=(0.1, 4.0 * largest), xlabel="rms error (µm)")
    axes.set_xticks([t for t in (0.1, 1.0, 10.0, 100.0) if t <= 4.0 * largest], minor=False)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    labels = [name.replace(" with dynamics", "\nwith dynamics").replace("oracle: ", "oracle:\n") for name in names]
    axes.set_yticks(np.arange(len(names)), labels)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_axisbelow(True)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.04, 1.0), ncols=2, fontsize="small", borderaxespad=0.2)


def _reference(axes: Axes, run: ClosedLoop, shown: slice | NDArray[np.bool_] = slice(None)) -> None:
    reference = MICRO * run.reference[shown]
    axes.plot(run.timepts[shown], reference, color=Hue.INK, linewidth=2.4, alpha=0.3, label="reference")


def _fleet(runs: Sequence[FleetRun]) -> Drawing:
    """Steps and tones of the six, with their errors below."""
    columns: dict[str, Array] = {}
    with draw((9.6, 5.4)) as figure:
        panels = figure.subplots(2, 2, sharex="col", height_ratios=(1.5, 1.0))
        for column, kind in enumerate(("steps", "tones")):
            above, below = panels[:, column]
            every = [getattr(run, kind) for run in runs]
            longest = max(every, key=lambda run: run.timepts.size)
            shown = longest.timepts <= (np.inf if kind == "steps" else STRETCH)
            _reference(above, longest, shown)
            columns |= {f"{kind}_time_s": longest.timepts, f"{kind}_reference_um": MICRO * longest.reference}
            for (colour, line), fleet_run, run in zip(STYLES, runs, every, strict=False):
                part, name = shown[: run.timepts.size], fleet_run.actuator.name
                style = {"color": colour, "linewidth": 0.9}
                above.plot(run.timepts[part], MICRO * run.output[part], line, label=name, **style)
                below.plot(run.timepts[part], MICRO * run.error[part], line, **style)
                columns[f"{kind}_{name.replace(' ', '').lower()}_output_um"] = MICRO * run.output
            titled(above, kind)
            below.set_xlabel("time (s)")
        panels[0, 0].set_ylabel("displacement (µm)")
        panels[1, 0].set_ylabel("error (µm)")
        figure.align_ylabels(panels[:, 0])
        legend_above(figure, panels[0, 0], 7)
        return WORDS.drawing(figure, "fleet", filled(columns), stretch=STRETCH, whole=longest.timepts[-1])


def _concealed(every: Sequence[Concealed]) -> Drawing:
    """Steps of both designs on the true plant, an effect a panel."""
    columns: dict[str, Array] = {}
    with draw((9.6, 2.0 + 2.0 * len(every))) as figure:
        panels = figure.subplots(len(every), 1, squeeze=False)[:, 0]
        for axes, one in zip(panels, every, strict=True):
            longest = max((d.runs.steps for d in one.designs), key=lambda run: run.timepts.size)
            _reference(axes, longest)
            columns |= {
                f"{one.effect}_time_s": longest.timepts,
                f"{one.effect}_reference_um": MICRO * longest.reference,
            }
            for designed, colour in zip(one.designs, (Hue.BEFORE, Hue.AFTER), strict=True):
                run, label = designed.runs.steps, f"design from the {designed.source} model"
                axes.plot(run.timepts, MICRO * run.output, color=colour, label=label)
                columns[f"{one.effect}_{designed.source}_output_um"] = MICRO * run.output
            said, was = (
                ", ".join(f"{d.source} {getattr(d, kind).verdict.value}" for d in one.designs)
                for kind in ("check", "truth")
            )
            title = f"{one.effect.replace('_', ' ')} concealed. Check: {said}. True rig: {was}"
            titled(axes, title)
            axes.set_ylabel("displacement (µm)")
        panels[-1].set_xlabel("time (s)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "concealed", filled(columns))


# --- predictions ----------------------------------------------------------------------------------------------------


def _models(matters: Matters) -> Drawing:
    """Interval and achieved number, a panel for each quantity."""
    names = [matter.name for matter in matters.models]
    with draw((9.6, 3.4)) as figure:
        panels = figure.subplots(1, len(QUANTITIES), sharey=True)
        for axes, quantity in zip(panels, QUANTITIES, strict=True):
            for promise in (p for p in matters.promises if p.quantity is quantity):
                row, p = names.index(promise.model), promise.predicted
                axes.plot([p.low, p.high], [row, row], color=Hue.AFTER, linewidth=5, alpha=0.4, solid_capstyle="butt")
                axes.plot(p.value, row, "|", color=Hue.AFTER, markersize=10, markeredgewidth=2)
                axes.plot(promise.achieved, row, "D", color=Hue.INK if promise.kept else Hue.BEFORE, markersize=5)
            axes.set(xscale="log", xlabel=quantity.label)
            numbers_of_decades(axes.xaxis, 50.0)
            axes.margins(x=0.12)
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.5, -0.5)
        figure.legend(handles=_handles(), loc="outside upper left", ncols=3, markerscale=1)
        rows = [
            (
                p.model,
                p.quantity.column,
                *(f"{v:.5g}" for v in (p.predicted.value, p.predicted.low, p.predicted.high, p.achieved)),
                int(p.kept),
            )
            for p in matters.promises
        ]
        return WORDS.drawing(
            figure, "models", csv_text(("model", "quantity", "predicted", "low", "high", "achieved", "inside"), rows)
        )


def _handles() -> list[object]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=Hue.AFTER, linewidth=5, alpha=0.4, label="predicted, 95 % interval"),
        Line2D([], [], linestyle="", marker="D", color=Hue.INK, markersize=5, label="achieved, inside"),
        Line2D([], [], linestyle="", marker="D", color=Hue.BEFORE, markersize=5, label="achieved, outside"),
    ]


def _trials(outcomes: Sequence[Outcome]) -> Drawing:
    verdicts = verdicts_seen(outcomes)
    with draw((9.6, 3.8)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.9))
        _draw_confusion(left, outcomes, verdicts)
        _draw_times(right, outcomes, verdicts)
        legend_above(figure, right, 4)
        return WORDS.drawing(figure, "trials", trials_csv(outcomes))


def _draw_confusion(axes: Axes, outcomes: Sequence[Outcome], verdicts: Sequence[str]) -> None:
    from matplotlib.patches import Rectangle

    truths = [truth for truth in TRUTHS if truth is not None or any(o.sound is None for o in outcomes)]
    for row, verdict in enumerate(verdicts):
        for column, truth in enumerate(truths):
            count = sum(o.verdict == verdict and o.sound is truth for o in outcomes)
            if count:
                passed = verdict == Verdict.PASS.value
                caution = truth is None or (truth and not passed)
                colour = Hue.MEASURED if caution else Hue.AFTER if passed is truth else Hue.BEFORE
                depth = 0.2 + 0.5 * count / len(outcomes)
                axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, color=colour, alpha=depth, linewidth=0))
            axes.text(column, row, str(count), ha="center", va="center")
    axes.set_xticks(range(len(truths)), [TRUTHS[truth] for truth in truths])
    axes.set_yticks(range(len(verdicts)), verdicts)
    axes.set(xlim=(-0.5, len(truths) - 0.5), ylim=(len(verdicts) - 0.5, -0.5))
    axes.set(xlabel="on the true rig", ylabel="verdict of the check")
    axes.grid(False)


def _draw_times(axes: Axes, outcomes: Sequence[Outcome], verdicts: Sequence[str]) -> None:
    places = np.random.default_rng(0).uniform(-JITTER, JITTER, len(outcomes))
    for outcome, place in zip(outcomes, places, strict=True):
        colour, marker = MARKS[outcome.sound]
        hollow = outcome.inside is not None and outcome.inside < 1.0
        style: dict[str, Any] = {
            "color": colour,
            "markersize": 6,
            "markerfacecolor": "none" if hollow else colour,
            "linestyle": "",
        }
        axes.plot(outcome.closed_loop_time, verdicts.index(outcome.verdict) + place, marker, label="_", **style)
    for truth, words in TRUTHS.items():
        if any(outcome.sound is truth for outcome in outcomes):
            colour, marker = MARKS[truth]
            axes.plot([], [], marker, color=colour, markersize=6, linestyle="", label=words)
    axes.set(xscale="log", xlabel="closed-loop time asked for (s)", ylim=(len(verdicts) - 0.5, -0.5))
    axes.set_yticks(range(len(verdicts)), verdicts)
    numbers_of_decades(axes.xaxis, 50.0)
    axes.grid(axis="y", visible=False)
    for edge in range(1, len(verdicts)):
        axes.axhline(edge - 0.5, color=COLOURS["grid"][0], linewidth=0.8)
