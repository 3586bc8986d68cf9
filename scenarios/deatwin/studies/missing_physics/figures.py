"""Figures of the scenarios: held-out recordings, residuals, and the missing force over its state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.drawing import envelope
from deatwin.plant.model import Plant
from deatwin.studies.missing_physics.case import Case, Law, Trial
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.svg import draw, legend_above

Array = NDArray[np.float64]
ZOOM = 300  # Samples in the magnified part, which are drawn one by one
DRAWN = 4000  # Most points of a long line, drawn as the extremes of its pieces


def held_out(case: Case, trial: Trial) -> Drawing:
    """Draw the recording with both plants: in full, and where the base plant fails most."""
    held, rig = trial.held_out, case.plant.rig
    time, scale = held.timepts, case.scale
    measured, base, amended = ((y - held.level) / scale for y in (held.measured, trial.base, trial.amended))
    peak = int(np.argmax(np.abs(measured - base)))
    first = int(np.clip(peak - ZOOM // 2, 0, max(measured.size - ZOOM, 0)))
    near = slice(first, first + ZOOM)
    label = f"{rig.output_name}{f' − {rig.input_name}' if held.follows else ''} ({case.unit})"
    with draw((9.6, 5.6)) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=(2, 3))
        top.plot(*envelope(time, measured, DRAWN // 2), color=Hue.MEASURED, linewidth=0.5)
        top.axvspan(time[near][0], time[near][-1], color=Hue.MARK, alpha=0.3, linewidth=0)
        top.set(ylabel=label)
        bottom.plot(time[near], base[near], color=Hue.BEFORE, label="calibrated base plant")
        bottom.plot(time[near], amended[near], color=Hue.AFTER, linewidth=1.6, label="amended plant")
        bottom.plot(time[near], measured[near], ".", color=Hue.INK, markersize=3.0, label="recording")
        bottom.set(ylabel=label, xlabel="time (s)")
        legend_above(figure, bottom, 3)
        columns = {"time_s": time, "recording": measured, "base": base, "amended": amended}
        return Drawing.of(
            figure,
            "held_out",
            f"{case.title}: {trial.held_out.name}",
            "Free runs over a held-out recording. Above: all of it; below: the ochre part, around the largest error of "
            "the base plant.",
            {name: values[near] for name, values in columns.items()},
        )


def residuals(case: Case, trial: Trial) -> Drawing:
    """Draw the residuals of both plants over time and over frequency."""
    from scipy.signal import welch

    time, rate = trial.held_out.timepts, 1 / case.plant.rig.sample_time
    measured = trial.held_out.measured / case.scale
    columns: dict[str, Array] = {}
    with draw((9.6, 5.2)) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=(3, 2))
        for name, readings, colour in (("base", trial.base, Hue.BEFORE), ("amended", trial.amended, Hue.AFTER)):
            left = measured - readings / case.scale
            frequencies, density = welch(left, rate, nperseg=min(2048, left.size // 4))
            columns |= {"frequency_Hz": frequencies[1:], name: np.sqrt(density)[1:]}
            label = f"{'calibrated base' if name == 'base' else name} plant: {np.sqrt(np.mean(left**2)):.3g} rms"
            top.plot(*envelope(time, left, DRAWN // 2), color=colour, linewidth=0.8, label=label)
            bottom.loglog(frequencies[1:], np.sqrt(density)[1:], color=colour)
        top.set(ylabel=f"measured − simulated ({case.unit})", xlabel="time (s)")
        bottom.set(ylabel=f"density ({case.unit}/√Hz)", xlabel="frequency (Hz)")
        legend_above(figure, top, 2)
        return Drawing.of(
            figure,
            "residuals",
            f"{case.title}: residual of {trial.held_out.name}",
            "Measured minus simulated (free run), without and with the effect that was found.",
            columns,
        )


def law(case: Case, found: Law) -> Drawing:
    """Draw the missing force over the quantity on which it depends."""
    with draw((6.4, 4.2)) as figure:
        axes = figure.add_subplot()
        if found.measured[0].size:
            step = max(found.measured[0].size // DRAWN, 1)
            axes.plot(*(v[::step] for v in found.measured), ".", color=Hue.MEASURED, markersize=1.5, label="recording")
        step = max(found.modelled[0].size // DRAWN, 1)
        axes.plot(*(v[::step] for v in found.modelled), ".", color=Hue.AFTER, markersize=2.0, label="amended plant")
        axes.set(xlabel=found.state, ylabel=found.force)
        legend_above(figure, axes, 2)
        columns = {"state": found.modelled[0], "missing": found.modelled[1]}
        title = f"{case.title}: the missing physics as a function of its state"
        return Drawing.of(figure, "law", title, found.caption, columns)


def drawings(case: Case, trial: Trial, amended: Plant | None) -> list[Drawing]:
    """Draw all figures; the law only if an effect was named."""
    made = [held_out(case, trial), residuals(case, trial)]
    return made if amended is None else [*made, law(case, case.law(amended))]
