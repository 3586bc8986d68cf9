"""Figures of the runs: steps on the plant and on the alternatives, and the sine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.app.check_report.view import View, header, thinned
from deatwin.control import ClosedLoop
from deatwin.control.checking.verdict import late_rms_error
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.drawing import envelope
from deatwin.studies.report.drawing import Drawing, Hue, draw, filled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = dict[str, Array]

_TIME = "time since the loop was closed (s)"


def draw_steps(view: View, steps: ClosedLoop) -> Drawing:
    """Draw the steps of the plant model in the predicted band, and the command below."""
    with draw((7.0, 4.8)) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.5))
        _draw_prediction(upper, view)
        faint = {"linewidth": 0.5, "alpha": 0.6}
        _draw(upper, view, steps, steps.measured, color=Hue.MEASURED, label="simulated reading", **faint)
        _draw_reference(upper, view, steps)
        _draw(upper, view, steps, steps.output, color=Hue.BEFORE, linewidth=1.3, label="plant model")
        upper.set_ylabel(view.reading)
        _draw_command(lower, steps, Hue.BEFORE)
        _draw_limits(lower, view, steps)
        figure.align_ylabels()
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        caption = "Steps of the reference and the response of the plant model; dotted: the limits of the command."
        if view.check.predicted is not None:
            caption += (
                " The band contains 95 % of the predicted loops at all times simultaneously. In these loops, "
                "the parameters are drawn from the posterior, and the model's free-run residual and sensor noise are added."
            )
        else:
            caption += (
                " No band is predicted, because every draw of the model diverged, or because the model's free-run "
                "error is unknown."
            )
        return Drawing.of(
            figure, "steps", "Steps in simulation with the plant model", caption, _step_columns(view, steps)
        )


def draw_others(view: View, others: Mapping[str, ClosedLoop]) -> Drawing:
    """Draw the steps on the other plants."""
    longest = max(others.values(), key=lambda run: run.timepts.size)
    with draw((7.0, 4.9)) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.5))
        _draw_prediction(upper, view)
        _draw_reference(upper, view, longest)
        for name, run in others.items():
            look = view.looks[name]
            style = {"color": look.colour, "linestyle": look.line, "linewidth": 1.2}
            _draw(upper, view, run, run.output, label=look.label, **style)
            lower.plot(*envelope(run.timepts, run.command), **style)
        upper.set_ylabel(view.reading)
        lower.set(xlabel=_TIME, ylabel=view.command)
        _draw_limits(lower, view, longest)
        figure.align_ylabels()
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return Drawing.of(
            figure,
            "rivals",
            "The same steps on the alternative plants",
            "Responses of the alternative plants with the same controller. A line ends early if its plant failed.",
            _other_columns(view, others, longest),
        )


def draw_sine(view: View, sine: ClosedLoop) -> Drawing:
    """Draw the run with a slow sine, its error, and the command."""
    unit, error = view.shown_unit, sine.error / view.size
    with draw((7.0, 5.2)) as figure:
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1.5))
        _draw_reference(upper, view, sine)
        _draw(upper, view, sine, sine.output, color=Hue.BEFORE, label="plant model")
        middle.plot(*envelope(sine.timepts, error), color=Hue.BEFORE, linewidth=0.9)
        middle.axhline(0, color=Hue.INK, linewidth=0.6)
        caption = "A sine at a fifth of the required bandwidth, the response of the plant model, and the error."
        if view.check.sine_predicted is not None and error.size:
            size = np.sqrt(2.0) * view.check.sine_predicted / view.size
            for sign in (1.0, -1.0):
                label = "predicted amplitude" if sign > 0 else "_"
                middle.axhline(sign * size, color=Hue.AFTER, linestyle="--", linewidth=0.9, label=label)
            caption += (
                f" The rms error is {view.check.sine_predicted / view.size:.3g} {unit}".rstrip()
                + f" as predicted by the linearised model, and {late_rms_error(sine) / view.size:.3g} {unit}".rstrip()
                + " in the last two thirds of the simulated run."
            )
        upper.set_ylabel(view.reading)
        middle.set_ylabel(axis_label("error", unit))
        _draw_command(lower, sine, Hue.BEFORE)
        lower.set(xlabel=_TIME, ylabel=view.command)
        figure.align_ylabels()
        handles, labels = (
            [*a, *b] for a, b in zip(upper.get_legend_handles_labels(), middle.get_legend_handles_labels(), strict=True)
        )
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
        return Drawing.of(
            figure,
            "sine",
            "A slow sine in simulation with the plant model",
            caption,
            {"time_s": sine.timepts, **_run_columns(view, sine)},
        )


def _draw_prediction(axes: Axes, view: View) -> None:
    predicted = view.check.predicted
    if predicted is None:
        return
    timepts, middle, half = thinned(predicted.timepts, predicted.middle / view.size, predicted.half_width / view.size)
    axes.fill_between(
        timepts, middle - half, middle + half, color=Hue.AFTER, alpha=0.22, linewidth=0, label="predicted 95 % band"
    )
    axes.plot(timepts, middle, color=Hue.AFTER, linewidth=1.0, label="predicted mean")


def _draw_reference(axes: Axes, view: View, run: ClosedLoop) -> None:
    _draw(axes, view, run, run.reference, color=Hue.INK, linestyle="--", linewidth=0.8, label="reference")


def _draw(axes: Axes, view: View, run: ClosedLoop, values: Array, **style: Any) -> None:
    axes.plot(*envelope(run.timepts, values / view.size), **style)


def _draw_command(axes: Axes, run: ClosedLoop, colour: str) -> None:
    axes.plot(*envelope(run.timepts, run.command), color=colour, linewidth=0.9, drawstyle="steps-post")


def _draw_limits(axes: Axes, view: View, run: ClosedLoop) -> None:
    for limit in run.command_limits:
        axes.axhline(limit, color=Hue.INK, linestyle=":", linewidth=1.0)
    axes.set(xlabel=_TIME, ylabel=view.command)


def _run_columns(view: View, run: ClosedLoop) -> Columns:
    unit, scale = view.unit, view.size
    return {
        header("reference", unit): run.reference / scale,
        header("achieved", unit): run.output / scale,
        header("simulated_reading", unit): run.measured / scale,
        header("command", view.check.operating.input_unit): run.command,
    }


def _step_columns(view: View, steps: ClosedLoop) -> Mapping[str, Array]:
    """Return columns over the whole predicted reference; a run that failed earlier ends in gaps."""
    columns = {"time_s": steps.timepts, **_run_columns(view, steps)}
    if (predicted := view.check.predicted) is None:
        return columns
    unit, scale = view.unit, view.size
    whole = {"time_s": predicted.timepts, header("reference", unit): predicted.reference / scale}
    band = {
        header("predicted", unit): predicted.middle / scale,
        header("low", unit): (predicted.middle - predicted.half_width) / scale,
        header("high", unit): (predicted.middle + predicted.half_width) / scale,
    }
    return filled({**columns, **whole, **band})


def _other_columns(view: View, others: Mapping[str, ClosedLoop], longest: ClosedLoop) -> Mapping[str, Array]:
    columns = {"time_s": longest.timepts, header("reference", view.unit): longest.reference / view.size}
    for name, run in others.items():
        columns[header(f"achieved_{name}", view.unit)] = run.output / view.size
        columns[header(f"command_{name}", view.check.operating.input_unit)] = run.command
    return filled(columns)
