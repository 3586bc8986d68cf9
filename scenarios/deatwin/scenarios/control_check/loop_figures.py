"""Figures of closed loops: tracking, the six actuators, and a concealed effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.scenarios.control_check.concealed import Concealed
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import SETTLED, FleetRun, Tracking
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, GREY, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
STYLES = ((AFTER, "-"), (BEFORE, "-"), (MARK, "-"), (GREY, "-"), (INK, "-"), (AFTER, "--"))
"""Of the six."""
MICRO = 1e6
STRETCH = 10.0
"""Of the tones that is drawn, s."""
ORACLE = "oracle: inverse with dynamics"
SHOWN = {
    "PI": (BEFORE, "-", "PI alone"),
    "inverse": (AFTER, "-", "PI behind the inverse"),
    "inverse with dynamics": (MARK, "-", "the same, with dynamics"),
    ORACLE: (INK, ":", "oracle, with dynamics"),
}


def loop_drawings(study: Study) -> list[tuple[Drawing, Columns]]:
    """Draw what the loops did."""
    return [_tracking(study.tracking), _fleet(study.fleet), _concealed(study.concealed)]


def _tracking(every: Sequence[Tracking]) -> tuple[Drawing, Columns]:
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
                    part = _stretch(run)
                    axes.plot(run.timepts[part], MICRO * run.error[part], line, color=colour, label=label)
            axes.set_ylabel("error (µm)")
        above.set_title(f"{nominal.name}: all", loc="left", fontsize="medium")
        below.set_title("the two smallest, enlarged", loc="left", fontsize="medium")
        below.set_xlabel("time (s)")
        above.tick_params(labelbottom=False)
        _rms(figure.add_subplot(grid[:, 1]), every)
        legend_above(figure, above, 4)
        drawing = Drawing.of(
            figure,
            "tracking",
            "Tracking tones of 0.1 to 0.8 Hz",
            f"Reference minus the noise-free output, and its rms from {SETTLED:g} s on. All controllers have the same "
            "feedback rule; those named oracle are designed on the true plant's static curve and linear model. The "
            "specification has hysteresis, which no static curve inverts.",
        )
    columns: dict[str, Array] = {}
    for tracking in every:
        longest = max((one.run for one in tracking.tracked.values()), key=lambda run: run.timepts.size)
        where = tracking.name.replace(" ", "_")
        columns |= {"time_s": longest.timepts, f"{where}_reference_um": MICRO * longest.reference}
        for name, one in tracking.tracked.items():
            key = name.replace(": ", "_").replace(" ", "_")
            columns[f"{where}_{key}_error_um"] = MICRO * _filled(one.run.error, longest.timepts.size)
    return drawing, columns


def _stretch(run: ClosedLoop) -> slice:
    first = int(np.searchsorted(run.timepts, SETTLED))
    return slice(first, int(np.searchsorted(run.timepts, SETTLED + STRETCH)))


def _rms(axes: Axes, every: Sequence[Tracking]) -> None:
    """Bars from the lower end of a logarithmic axis."""
    names = list(every[0].tracked)
    colours = (AFTER, GREY)
    height = 0.8 / len(every)
    largest = 0.0
    for place, tracking in enumerate(every):
        values = np.array([MICRO * tracking.tracked[name].rms for name in names])
        rows = np.arange(len(names)) + (place - 0.5 * (len(every) - 1)) * height
        shown = np.where(np.isfinite(values), values, 0.0)
        axes.barh(rows, shown, height=0.92 * height, color=colours[place % 2], alpha=0.8, label=tracking.name)
        for row, value in zip(rows, values, strict=True):
            text = f"{value:.3g}" if np.isfinite(value) else "failed"
            axes.annotate(
                text,
                (value if np.isfinite(value) else 0.1, row),
                xytext=(3, 0),
                va="center",
                textcoords="offset points",
                fontsize="small",
            )
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


def _fleet(runs: Sequence[FleetRun]) -> tuple[Drawing, Columns]:
    """Steps and tones of the six, with their errors below."""
    columns: dict[str, Array] = {}
    with draw((9.6, 5.4)) as figure:
        panels = figure.subplots(2, 2, sharex="col", height_ratios=(1.5, 1.0))
        for column, kind in enumerate(("steps", "tones")):
            above, below = panels[:, column]
            every = [getattr(run, kind) for run in runs]
            longest = max(every, key=lambda run: run.timepts.size)
            shown = longest.timepts <= (np.inf if kind == "steps" else STRETCH)
            above.plot(
                longest.timepts[shown],
                MICRO * longest.reference[shown],
                color=INK,
                linewidth=2.4,
                alpha=0.3,
                label="reference",
            )
            columns |= {f"{kind}_time_s": longest.timepts, f"{kind}_reference_um": MICRO * longest.reference}
            for (colour, line), fleet_run, run in zip(STYLES, runs, every, strict=False):
                part = shown[: run.timepts.size]
                above.plot(
                    run.timepts[part],
                    MICRO * run.output[part],
                    line,
                    color=colour,
                    linewidth=0.9,
                    label=fleet_run.actuator.name,
                )
                below.plot(run.timepts[part], MICRO * run.error[part], line, color=colour, linewidth=0.9)
                key = fleet_run.actuator.name.replace(" ", "").lower()
                columns[f"{kind}_{key}_output_um"] = MICRO * _filled(run.output, longest.timepts.size)
            above.set_title(kind, loc="left", fontsize="medium")
            below.set_xlabel("time (s)")
        panels[0, 0].set_ylabel("displacement (µm)")
        panels[1, 0].set_ylabel("error (µm)")
        figure.align_ylabels(panels[:, 0])
        legend_above(figure, panels[0, 0], 7)
        drawing = Drawing.of(
            figure,
            "fleet",
            "The scheduled design on the six actuators",
            "One gain schedule, made on the identified model of the specification, which is none of the six: they are "
            "fabricated beside it, and drift as they are used. Outputs without noise; of the tones "
            f"{STRETCH:g} of {longest.timepts[-1]:.0f} s.",
        )
    length = max(values.size for values in columns.values())
    return drawing, {name: _filled(values, length) for name, values in columns.items()}


def _concealed(every: Sequence[Concealed]) -> tuple[Drawing, Columns]:
    """Steps of both designs on the true plant, an effect a panel."""
    columns: dict[str, Array] = {}
    with draw((9.6, 2.0 + 2.0 * len(every))) as figure:
        panels = figure.subplots(len(every), 1, squeeze=False)[:, 0]
        for axes, one in zip(panels, every, strict=True):
            longest = max((d.runs.steps for d in one.designs), key=lambda run: run.timepts.size)
            wanted = MICRO * longest.reference
            axes.plot(longest.timepts, wanted, color=INK, linewidth=2.4, alpha=0.3, label="reference")
            columns |= {f"{one.effect}_time_s": longest.timepts, f"{one.effect}_reference_um": wanted}
            for designed, colour in zip(one.designs, (BEFORE, AFTER), strict=True):
                run = designed.runs.steps
                label = f"design from the {designed.source} model"
                axes.plot(run.timepts, MICRO * run.output, color=colour, label=label)
                key = f"{one.effect}_{designed.source}_output_um"
                columns[key] = MICRO * _filled(run.output, longest.timepts.size)
            said, was = (
                ", ".join(f"{d.source} {getattr(d, kind).verdict.value}" for d in one.designs)
                for kind in ("check", "truth")
            )
            title = f"{one.effect.replace('_', ' ')} concealed. Check: {said}. True rig: {was}"
            axes.set_title(title, loc="left", fontsize="medium")
            axes.set_ylabel("displacement (µm)")
        panels[-1].set_xlabel("time (s)")
        legend_above(figure, panels[0], 3)
        drawing = Drawing.of(
            figure,
            "concealed",
            "What a concealed effect does to a design",
            "Steps on the true rig, which no check sees. Both designs follow one rule; one is made on the plant "
            "without the effect, as well as it can be fitted, the other on the plant that the diagnosis of the "
            "recording amended.",
        )
    length = max(values.size for values in columns.values())
    return drawing, {name: _filled(values, length) for name, values in columns.items()}


def _filled(values: Array, length: int) -> Array:
    """As long as the others, NaN where there is nothing."""
    return np.concatenate([values, np.full(length - values.size, np.nan)])
