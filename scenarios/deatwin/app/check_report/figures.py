"""The figures of a check: margins with their loop gains, and runs of the closed loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.app.check_report.view import View, header, thinned
from deatwin.control import ClosedLoop
from deatwin.control.checking.rows import LOWS, MarginRow
from deatwin.control.checking.specification import Limit
from deatwin.control.checking.verdict import late_rms_error
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.stability.bands import MarginBand, band_margins, evenly_along
from deatwin.plant.amplitudes import amount, axis_label
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.drawing import Axes, envelope, plain_numbers
from deatwin.studies.report.drawing import Drawing, Hue, draw, filled, legend_above

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
        legend_above(figure, upper, 3)
        caption = (
            "Steps of the reference, and the response of the plant model. Dotted lines are the limits of the command."
        )
        if view.check.predicted is not None:
            caption += (
                " The band contains 95 % of the responses that the identified model predicts, at all times simultaneously. "
                "The band includes the uncertainty of the parameters, the free-run error of the model, and sensor noise."
            )
        else:
            caption += (
                " There is no predicted band, because every model drawn from the posterior diverged or the free-run error of the "
                "model is unknown."
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
        legend_above(figure, upper, 3)
        return Drawing.of(
            figure,
            "rivals",
            "The same steps with the alternative plant models",
            "Responses of the alternative plant models with the same controller. A line ends early if its simulation failed.",
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
        caption = "Sine reference at a fifth of the required bandwidth, response of the plant model, and error."
        if view.check.sine_predicted is not None and error.size:
            size = np.sqrt(2.0) * view.check.sine_predicted / view.size
            for sign in (1.0, -1.0):
                label = "predicted amplitude of the error" if sign > 0 else "_"
                middle.axhline(sign * size, color=Hue.AFTER, linestyle="--", linewidth=0.9, label=label)
            caption += (
                f" The identified model predicts an rms error of {view.check.sine_predicted / view.size:.3g} {unit}".rstrip()
                + f"; in the last two thirds of the simulation with the plant model, the rms error is {late_rms_error(sine) / view.size:.3g} {unit}".rstrip()
                + "."
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


_POINTS = 400  # points of each half of the grid, one logarithmic and one even, to resolve a narrow resonance
_LOWEST = 0.05  # lowest frequency, as a share of the closed loop's bandwidth


@dataclass(frozen=True, kw_only=True, eq=False)
class Loops:
    """Loop gains at the controller's operating point."""

    frequency_Hz: Array  # shape (n,): Hz
    values: dict[str, Complex]  # shape (n,): Loop gains of the model and of each plant that has a state of rest there
    band: MarginBand | None  # Margins of the model's loop, from the model's covariance; None if the loop is unstable

    @classmethod
    def of(cls, view: View, controller: Controller) -> Loops:
        """Compute the loop gains."""
        at, reading = controller.operating_input, view.plants["plant"].rig.reading
        models = {"model": linearise(view.model, at).in_loop(reading)}
        for name, plant in view.plants.items():
            linear = linearise_plant(plant, at)
            if linear.operating_output is not None:
                models[name] = linear.in_loop(plant.rig.reading)
        h = controller.sample_time
        lowest, highest = _LOWEST / (2 * np.pi * controller.closed_loop_time), 0.5 / h
        frequency = np.union1d(np.geomspace(lowest, highest, _POINTS), np.linspace(lowest, highest, _POINTS)).clip(
            max=highest
        )
        local = controller.local(at)
        law = local.feedback_response(2 * np.pi * frequency, h)
        values = {name: np.asarray(law * m.response(2 * np.pi * frequency)) for name, m in models.items()}
        stable = view.check.margins is not None and view.check.margins.phase_deg > 0.0
        band = band_margins(models["model"], *local.feedback) if stable else None
        return cls(frequency_Hz=frequency, values=values, band=band)


_REACH = 2.2  # half width of the drawn part of the Nyquist plane
_ELLIPSES = 24
_LONG = 26  # letters of a label beyond which only two labels fit beside each other
_FAR = 15.0  # multiple of a limit from which on an axis is logarithmic


@dataclass(frozen=True, kw_only=True)
class _Measure:
    """A margin to be drawn."""

    field: str
    label: str
    limit: Limit  # Limit from the specification
    scale: float = 1.0
    ceiling: float = np.inf  # Value from which on a margin is drawn at the edge

    def values(self, rows: list[MarginRow]) -> tuple[Array, Array]:
        """Return a source's own margins and their low quantiles, each of shape (n,)."""
        names = (self.field, LOWS[self.field])
        own, least = (np.array([getattr(row, name) for row in rows]) / self.scale for name in names)
        return own, least

    def reach(self, values: list[float]) -> tuple[float, float]:
        """Return the ends of the axis, which is logarithmic if a margin is far above its limits."""
        finite = [v for v in values if np.isfinite(v)]
        wanted = 1.15 * max([*finite, 2.0 * self.limit.good])
        high = self.ceiling if len(finite) < len(values) else min(self.ceiling, wanted)
        return (0.0 if high < _FAR * self.limit.poor else 0.6 * self.limit.poor), high


def draw_margins(view: View, *, along_time: bool) -> Drawing:
    """Draw margins over operating points or over time."""
    rows, measures = view.rows(along_time), _measures(view)
    if along_time:
        name, title, label, column = "margins_time", "Margins over time", "time (s)", "time_s"
    else:
        name, title, label = "margins", "Margins over operating points", f"constant {view.command}"
        column = header("input", view.check.operating.input_unit)

    def place(row: MarginRow) -> float:
        return row.time or 0.0 if along_time else row.operating_input

    with draw((7.4, 5.4)) as figure:
        panels = figure.subplots(2, 2, sharex=True)
        for axes, measure in zip(panels.flat, measures, strict=True):
            low, high = measure.reach([v for found in rows.values() for v in np.concatenate(measure.values(found))])
            for source, found in rows.items():
                shown = (np.clip(v, low, high) for v in measure.values(found))
                _draw_source(axes, view, source, np.array([place(row) for row in found]), *shown)
            _draw_both_limits(axes, measure.limit, low, high)
            axes.set_ylabel(measure.label)
        for axes in panels[1]:
            axes.set_xlabel(label)
        figure.align_ylabels()
        handles = panels[0, 0].get_legend_handles_labels()
        columns = 3 if max(map(len, handles[1])) < _LONG else 2
        figure.legend(*handles, loc="outside upper left", ncols=columns, markerscale=1)
        samples = max((row.samples for found in rows.values() for row in found), default=1)
        caption = "Lines with dots show the margins of each model at its estimated parameters."
        if samples > 1:
            caption += " The verdict uses the thin line without dots of each model: 97.5 % of the draws of this model have a larger margin."
        caption += " A point on the upper edge of a panel stands for a margin that is infinite or too large for the axis. A point on the lower edge means that the closed loop is unstable."
        return Drawing.of(figure, name, title, caption, _columns(rows, place, column, measures))


def _measures(view: View) -> tuple[_Measure, ...]:
    spec, h = view.specification, view.check.operating.sample_time
    return (
        _Measure(field="gain", label="gain margin (factor)", limit=spec.gain, ceiling=100.0),
        _Measure(field="phase_deg", label="phase margin (°)", limit=spec.phase_deg, ceiling=180.0),
        _Measure(field="delay", label="delay margin (samples)", limit=spec.delay_samples, scale=h, ceiling=1000.0),
        _Measure(field="disk", label="disk margin", limit=spec.disk, ceiling=2.0),
    )


def _draw_source(axes: Axes, view: View, source: str, places: Array, own: Array, low: Array) -> None:
    look = view.looks[source]
    order = np.argsort(places)
    places, own, low = places[order], own[order], low[order]
    if places.size == 1:
        axes.plot(places.repeat(2), [own[0], low[0]], marker="_", color=look.colour, label=look.label)
        return
    axes.plot(
        places, own, marker="o", markersize=3.5, color=look.colour, linestyle=look.line, label=look.label, clip_on=False
    )
    if np.any(low < own):
        axes.plot(places, low, color=look.colour, linestyle=look.line, linewidth=0.7)
        axes.fill_between(places, low, own, color=look.colour, alpha=0.18, linewidth=0)


def _draw_both_limits(axes: Axes, limit: Limit, low: float, high: float) -> None:
    axes.axhline(limit.good, color=Hue.INK, linestyle="--", linewidth=0.9, label="pass from here on")
    axes.axhline(limit.poor, color=Hue.INK, linestyle=":", linewidth=1.1, label="fail below")
    if low > 0.0:
        axes.set_yscale("log")
        plain_numbers(axes.yaxis, 1.0, 2.0, 5.0)
    axes.set_ylim(low, high)


def _columns(
    rows: Mapping[str, list[MarginRow]],
    place: Callable[[MarginRow], float],
    column: str,
    measures: tuple[_Measure, ...],
) -> Columns:
    """Return one row per place, with NaN for sources without margins there."""
    places = np.unique([place(row) for found in rows.values() for row in found])
    columns: Columns = {column: places}
    for source, found in rows.items():
        at = np.searchsorted(places, [place(row) for row in found])
        for measure in measures:
            for what, values in zip(("", "_low"), measure.values(found), strict=True):
                columns[header(f"{source}_{measure.field}{what}", "samples" if measure.field == "delay" else "")] = (
                    filled := np.full(places.size, np.nan)
                )
                filled[at] = values
    return columns


def draw_nyquist(view: View, controller: Controller) -> Drawing:
    """Draw the loops at the operating point, with the disks that they must avoid."""
    loops = Loops.of(view, controller)
    known = view.check.excited_band_Hz
    with draw((6.4, 5.6)) as figure:
        axes = figure.add_subplot()
        _draw_disks(axes, view)
        _draw_ellipses(axes, loops)
        for source, values in loops.values.items():
            look = view.looks[source]
            axes.plot(values.real, values.imag, color=look.colour, linestyle=look.line, label=look.label)
            if known is not None and known < loops.frequency_Hz[-1]:
                at = int(np.argmin(np.abs(loops.frequency_Hz - known)))
                label = f"{known:.3g} Hz: excited up to here" if source == "model" else "_"
                axes.plot(values[at].real, values[at].imag, "D", markersize=5, color=look.colour, label=label)
        axes.plot(-1.0, 0.0, "+", color=Hue.INK, markersize=10, markeredgewidth=1.5, label="critical point −1")
        axes.set(xlim=(-_REACH, 0.8), ylim=(-_REACH, 0.8), xlabel="real part of L", ylabel="imaginary part of L")
        axes.set_aspect("equal")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3, markerscale=1)
        at_input = amount(f"{controller.operating_input:.4g}", view.check.operating.input_unit)
        caption = f"Nyquist plot of the loop gain L (controller times model) at {at_input}. Large values of |L| lie outside the figure."
        if loops.band is not None:
            caption += " The ellipses are the simultaneous 95 % band of the loop gain of the identified model."
        caption += (
            " The disk margin fails if the loop gain enters the smaller disk. The margin passes if, with 95 % confidence, the loop "
            "gain stays outside the larger disk at all operating points."
        )
        columns: Columns = {"frequency_Hz": loops.frequency_Hz}
        for source, values in loops.values.items():
            columns[header(f"{source}_real", "")], columns[header(f"{source}_imag", "")] = values.real, values.imag
        return Drawing.of(figure, "nyquist", "The loop at the operating point", caption, columns)


def _draw_disks(axes: Axes, view: View) -> None:
    """Draw a symmetric disk margin alpha: a circle through -(2 + alpha)/(2 - alpha) and its inverse on the real axis."""
    limit, turn = view.specification.disk, np.linspace(0.0, 2 * np.pi, 181)
    for margin, colour, label in (
        (limit.good, Hue.MARK, "pass: outside this disk"),
        (limit.poor, Hue.BEFORE, "fail: inside this disk"),
    ):
        far = (2.0 + margin) / (2.0 - margin)
        centre, radius = -0.5 * (far + 1.0 / far), 0.5 * (far - 1.0 / far)
        axes.fill(
            centre + radius * np.cos(turn), radius * np.sin(turn), color=colour, alpha=0.2, linewidth=0, label=label
        )


def _draw_ellipses(axes: Axes, loops: Loops) -> None:
    from matplotlib.collections import LineCollection

    if loops.band is None:
        return
    values = loops.band.response.values
    near = np.flatnonzero(np.abs(values) < 1.5 * _REACH)
    if not near.size:
        return
    outlines = loops.band.ellipse()[near[evenly_along(values[near], _ELLIPSES)]]
    lines = list(np.stack([outlines.real, outlines.imag], axis=-1))
    axes.add_collection(
        LineCollection(lines, colors=Hue.AFTER, linewidths=0.7, alpha=0.5, label="95 % band of the model")
    )
