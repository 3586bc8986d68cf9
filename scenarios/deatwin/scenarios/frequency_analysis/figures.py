"""The figures of the benchmark systems and of the fleet, after figures 4.10 to 4.12 of the thesis and in place of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.closed_forms import DUFFING, QUADRATIC, ClosedForm
from deatwin.ident.frequency.output_responses.settled import Evaluated, OrderRanges
from deatwin.ident.narx import Term
from deatwin.ident.narx.fleet import BAND, OPERATING_INPUT
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Axes, plain_numbers
from deatwin.scenarios.frequency_analysis.actuators import FREQUENCIES, GRID, ORDERS, Actuators, Analysed
from deatwin.scenarios.frequency_analysis.known import SIGNAL_BAND, Identified, Known
from deatwin.studies.report.drawing import (
    STYLES,
    SUBSCRIPTS,
    Drawing,
    Hue,
    draw,
    draw_between,
    filled,
    key_of,
    legend_above,
    panels_of,
    titled,
)
from deatwin.studies.report.words import Each, Words

WORDS = Words(__package__)
OF_ORDER = (Hue.AFTER, Hue.BEFORE, Hue.MARK)
SMALLEST = 1e-10  # Share of the largest line below which rounding is no longer drawn
HELD = 0.1  # Third frequency of the slice of H_3, Hz: near the resonance


def known_drawings(known: Known) -> list[Drawing]:
    """Draw the figures of the benchmark systems."""
    return [_ranges(known.ranges), _gfrfs(), _known_nofrfs(known.evaluated), _identified(known.identified)]


def map_of(axes: Axes, axis: Array, decibels: Array, levels: Array) -> object:
    """Draw a gain over two frequencies. Shapes: `axis` (n,); `decibels` (n * n,)."""
    drawn = axes.contourf(axis, axis, decibels.reshape(axis.size, axis.size).T, levels=levels, cmap="viridis")
    axes.set_aspect("equal")
    axes.grid(False)
    return drawn


def _ranges(found: Mapping[ClosedForm, OrderRanges]) -> Drawing:
    with draw((9.6, 4.6)) as figure:
        panels = panels_of(figure, 1, len(found), "frequency (Hz)", sharey=True)[0]
        for axes, (system, one) in zip(panels, found.items(), strict=True):
            f, simulated = one.frequency_Hz, np.abs(one.simulated)
            size = simulated.max()
            for n, (order, bands, colour) in enumerate(zip(one.orders, one.bands_Hz, OF_ORDER, strict=True), start=1):
                height = size * 2e-11 * 3.0 ** (len(one.orders) - n)
                low, high = bands.T
                axes.hlines(np.full(low.size, height), low - 1e-3, high + 1e-3, color=colour, linewidth=4)
                gain = np.where(order.gain > SMALLEST * size, order.gain, np.nan)
                axes.plot(f, gain, "o", color=colour, markersize=3, label=f"order {n}, bar: its range")
            there, hollow = simulated > SMALLEST * size, {"fillstyle": "none", "markersize": 6, "markeredgewidth": 0.6}
            axes.plot(f[there], simulated[there], "s", color=Hue.INK, label="simulated", **hollow)
            axes.set(yscale="log", ylim=(5e-12 * size, 4 * size))
            titled(axes, f"{system.name}: {system.shown}")
        panels[0].set_ylabel("Fourier coefficient of the output")
        legend_above(figure, panels[0], 4)
        low, high = next(iter(found.values())).signal.band_Hz
        return WORDS.drawing(figure, "ranges", low=low, high=high)


def _gfrfs() -> Drawing:
    """|H_1|, |H_2| and |H_3| of the two systems without a highest order."""
    from matplotlib.ticker import MaxNLocator

    axis, line = np.linspace(-0.5, 0.5, 81), np.linspace(0.002, 0.5, 250)
    grid = frequency_grid(axis, axis)
    third = np.column_stack([grid, np.full(len(grid), HELD)])
    columns: dict[str, Array] = {"f1_Hz": grid[:, 0], "f2_Hz": grid[:, 1]}
    with draw((9.6, 3.8)) as figure:
        left, *maps = figure.subplots(1, 3)
        for system, colour in ((QUADRATIC, Hue.AFTER), (DUFFING, Hue.BEFORE)):
            gain = gfrf(system.model, 1, 2 * np.pi * line).gain
            left.plot(line, gain, color=colour, label=f"{system.name}: {system.shown}")
            columns |= {"f_Hz": line, f"{system.name}_H1": gain}
        left.set(yscale="log", xlabel="frequency (Hz)", ylabel="|H₁|")
        for axes, system, order, points in ((maps[0], QUADRATIC, 2, grid), (maps[1], DUFFING, 3, third)):
            gain = gfrf(system.model, order, 2 * np.pi * points).gain
            columns[f"{system.name}_H{order}"] = gain
            decibels = 20 * np.log10(gain)
            levels = np.asarray(MaxNLocator(14).tick_values(decibels.min(), decibels.max()), dtype=np.float64)
            drawn, label = map_of(axes, axis, decibels, levels), f"|H{SUBSCRIPTS[order]}| (dB)"
            figure.colorbar(drawn, ax=axes, label=label, shrink=0.75)  # type: ignore[arg-type]
            axes.set(xlabel="f₁ (Hz)", ylabel="f₂ (Hz)")
            titled(axes, f"{system.name}, f₃ = {HELD:g} Hz" if order == 3 else system.name)
        legend_above(figure, left, 2)
        return WORDS.drawing(figure, "benchmark_gfrfs", filled(columns))


def _known_nofrfs(found: Mapping[ClosedForm, Evaluated]) -> Drawing:
    with draw((9.6, 5.4)) as figure:
        rows = panels_of(figure, len(found), 3, "frequency (Hz)", sharex=True)
        for row, (system, one) in zip(rows, found.items(), strict=True):
            for place, axes in enumerate(row):
                n, direct, fitted = place + 1, one.direct[place], one.fitted.orders[place]
                axes.plot(direct.frequency_Hz, direct.gain, color=OF_ORDER[place], label="from the model")
                axes.plot(fitted.frequency_Hz, fitted.gain, ".", color=Hue.INK, markersize=2.5, label="least squares")
                axes.axvline(n * SIGNAL_BAND[1], color=Hue.MEASURED, linestyle=":", label="end of its range")
                titled(axes, f"{system.name}: |G{SUBSCRIPTS[n]}|")
                axes.set_ylim(*((0, None) if direct.gain.any() else (-0.05, 1.0)))
        legend_above(figure, rows[0, 0], 3)
        return WORDS.drawing(figure, "benchmark_nofrfs")


def _identified(one: Identified) -> Drawing:
    with draw((9.6, 5.0)) as figure:
        panels, errors = panels_of(figure, 2, 3, "frequency (Hz)", sharex="col")
        for place, (axes, relative) in enumerate(zip(panels, errors, strict=True)):
            n, found, truth, colour = place + 1, one.orders[place], one.true_orders[place], OF_ORDER[place]
            band, there = found.band(), truth.gain > 1e-9 * truth.gain.max()
            f, true = found.frequency_Hz[there], truth.gain[there]
            low, high = (100 * (side[there] - true) / truth.gain.max() for side in (band.low, band.high))
            draw_between(relative, f, low, high, colour, alpha=0.35)
            relative.axhline(0, color=Hue.INK, linewidth=0.9)
            draw_between(axes, f, band.low[there], band.high[there], colour, "95 % band", alpha=0.35)
            axes.plot(f, true, color=Hue.INK, linewidth=0.9, label="true")
            titled(axes, f"|Y{SUBSCRIPTS[n]}|")
            axes.set_ylim(0, None)
        panels[0].set_ylabel("Fourier coefficient")
        errors[0].set_ylabel("band minus truth (% of largest)")
        legend_above(figure, panels[0], 2)
        coverage = Each(100 * one.coverage)
        return WORDS.drawing(figure, "identified", recordings=one.recordings, coverage=coverage)


MICRO = 1e6
ZOOM = 20.0  # Length of the free runs that are drawn, s
UNITS = ("µm/V", "µm/V²", "µm/V³")


def fleet_drawings(found: Actuators) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [
        _removal(found.shown),
        _first(found.each),
        _second(found.each),
        _test_signal(found),
        _nofrfs(found),
        _sampled(found),
    ]


def _removal(one: Analysed) -> Drawing:
    """The free run with the DC component removed, and with the constant deleted."""
    removal, section = one.removal, one.removal.section
    part = slice(0, round(ZOOM / section.sample_time))
    traces = {
        "measured": section.outputs[0],
        "model": removal.run,
        "of_deviations": removal.shifted_run,
        "not_expanded": removal.deleted_run,
    }
    shown = {name: MICRO / 1e3 * values[part] for name, values in traces.items()}
    timepts = section.timepts[part]
    with draw((9.6, 5.0)) as figure:
        near, far = figure.subplots(2, 1, sharex=True)
        for axes in (near, far):
            axes.plot(timepts, shown["measured"], ".", color=Hue.MEASURED, markersize=4, label="measured")
            axes.plot(timepts, shown["model"], color=Hue.AFTER, linewidth=3.0, alpha=0.5, label="model")
            axes.plot(
                timepts, shown["of_deviations"], color=Hue.INK, linewidth=0.8, label="model of deviations, put back"
            )
            axes.set_ylabel("displacement (mm)")
        far.plot(timepts, shown["not_expanded"], color=Hue.BEFORE, label="only a constant left out")
        far.set_xlabel("time (s)")
        legend_above(figure, far, 4)
        although = "" if Term(()) in removal.model.terms else WORDS.text("figure.removal.although")
        return WORDS.drawing(figure, "removal", name=one.name, although=although)


def _first(each: Sequence[Analysed]) -> Drawing:
    with draw((9.6, 4.2)) as figure:
        gain, phase = figure.subplots(1, 2)
        for one, (colour, line) in zip(each, STYLES, strict=False):
            response, band = one.first, one.first.band()
            middle, low, high = (MICRO * values for values in (response.gain, band.low, band.high))
            draw_between(gain, FREQUENCIES, low, high, colour, f"_{one.name}", alpha=0.15)
            gain.plot(FREQUENCIES, middle, color=colour, linestyle=line, label=one.name)
            phase.plot(FREQUENCIES, response.phase_deg, color=colour, linestyle=line, label=one.name)
        for axes in (gain, phase):
            axes.axvspan(BAND[1], FREQUENCIES[-1], color=Hue.MEASURED, alpha=0.12, linewidth=0)
            axes.set(xscale="log", xlabel="frequency (Hz)", xlim=(FREQUENCIES[0], FREQUENCIES[-1]))
            plain_numbers(axes.xaxis)
        gain.set(ylabel="|H₁| (µm/V)", ylim=(0, None))
        phase.set_ylabel("phase (°)")
        legend_above(figure, gain, 6)
        return WORDS.drawing(figure, "gfrf1", OPERATING_INPUT=OPERATING_INPUT)


def _second(each: Sequence[Analysed]) -> Drawing:
    every = {one.name: 20 * np.log10(MICRO * one.second.gain) for one in each}
    columns = {"f1_Hz": each[0].second.frequency_Hz[:, 0], "f2_Hz": each[0].second.frequency_Hz[:, 1]}
    columns |= {f"{key_of(name)}_um_per_V2": 10 ** (values / 20) for name, values in every.items()}
    low, high = (f(f(values) for values in every.values()) for f in (min, max))
    levels = np.arange(np.floor(low), np.ceil(high) + 1)
    with draw((9.6, 5.8)) as figure:
        panels = panels_of(figure, 2, 3, "f₁ (Hz)", sharex=True, sharey=True)
        for axes, (name, values) in zip(panels.ravel(), every.items(), strict=False):
            drawn = map_of(axes, GRID, values, levels)
            titled(axes, name)
        for axes in panels.ravel()[len(every) :]:
            axes.set_axis_off()
        for axes in panels[:, 0]:
            axes.set_ylabel("f₂ (Hz)")
        figure.colorbar(drawn, ax=panels, label="|H₂| (dB re 1 µm/V²)", shrink=0.8)  # type: ignore[arg-type]
        return WORDS.drawing(figure, "gfrf2", columns, OPERATING_INPUT=OPERATING_INPUT)


def _test_signal(found: Actuators) -> Drawing:
    """The record beside the test signal: both signals, their powers' spectra, and the NOFRF that each gives."""
    side, signal = found.side, found.signal
    n = side.random.size
    timepts = np.asarray((np.arange(n) - n // 2) * signal.sample_time, dtype=np.float64)
    equal = np.roll(signal.values, n // 2)
    with draw((9.6, 6.2)) as figure:
        (left, *above), below = figure.subplots(2, 3)
        left.plot(timepts, side.random, color=Hue.AFTER, label="random record")
        left.plot(timepts, equal, color=Hue.INK, label="test signal")
        left.set(xlabel="time (s)", ylabel="deviation (V)")
        inputs = {"random": (side.random_inputs, Hue.AFTER, "."), "designed": (side.designed_inputs, Hue.INK, "")}
        for axes, order in zip((*above, below[0]), (1, 2, 3), strict=True):
            for key, (spectra, colour, marker) in inputs.items():
                u = spectra[order - 1]
                inside = u.frequency_Hz <= order * BAND[1] + 1e-9
                shown = np.abs(u.values[inside])
                axes.plot(u.frequency_Hz[inside], shown, color=colour, marker=marker, markersize=3, label=key)
            unit = "V" + ("", "", "²", "³")[order]
            axes.set(yscale="log", xlabel="frequency (Hz)", ylabel=f"|U{SUBSCRIPTS[order]}| ({unit})")
        outputs = {"random": (side.by_random, Hue.AFTER, 4), "designed": (side.designed, Hue.INK, 0)}
        for axes, order in zip(below[1:], (2, 3), strict=True):
            for key, (fit, colour, size) in outputs.items():
                g = fit.orders[order - 1]
                how = {"marker": ".", "markersize": size, "linewidth": 0.9, "label": key}
                axes.plot(g.frequency_Hz, MICRO * g.gain, color=colour, **how)
            axes.set(yscale="log", xlabel="frequency (Hz)", xlim=(-0.1, order * BAND[1] + 0.1))
            axes.set_ylabel(f"|G{SUBSCRIPTS[order]}| ({UNITS[order - 1]})")
        legend_above(figure, left, 2)
        return WORDS.drawing(figure, "test_signal", name=found.shown.name)


def _nofrfs(found: Actuators) -> Drawing:
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, ORDERS, "frequency (Hz)")[0]
        for place, axes in enumerate(panels):
            n = place + 1
            for one, (colour, line) in zip(found.each, STYLES, strict=False):
                fitted, direct = one.nofrfs.fitted.orders[place], one.nofrfs.direct[place]
                axes.plot(fitted.frequency_Hz, MICRO * fitted.gain, color=colour, linestyle=line, label=one.name)
                label = f"_{one.name}, from the model"
                axes.plot(direct.frequency_Hz, MICRO * direct.gain, ".", color=colour, markersize=2, label=label)
            axes.set(ylabel=f"|G{SUBSCRIPTS[n]}| ({UNITS[place]})", ylim=(0, None))
        legend_above(figure, panels[0], 6)
        numbers = {"OPERATING_INPUT": OPERATING_INPUT, "highest": BAND[1], "amplitude": found.signal.amplitude}
        return WORDS.drawing(figure, "nofrfs", **numbers)


def _sampled(found: Actuators) -> Drawing:
    """Orders of the output with propagated bands, and those of drawn parameters."""
    one = found.sampled
    with draw((9.6, 3.6)) as figure:
        panels = panels_of(figure, 1, len(one.orders), "frequency (Hz)")[0]
        for place, axes in enumerate(panels):
            n, response, band = place + 1, one.orders[place], one.orders[place].band()
            there = response.gain > 1e-9 * response.gain.max()
            drawn = np.quantile(np.abs(one.draws[:, place]), (0.025, 0.975), axis=0)
            gain, low, high, drawn_low, drawn_high = (
                MICRO * values for values in (response.gain, band.low, band.high, *drawn)
            )
            f = response.frequency_Hz[there]
            draw_between(axes, f, low[there], high[there], Hue.AFTER, "95 % band, propagated", alpha=0.35)
            axes.plot(f, gain[there], color=Hue.AFTER, label="posterior mean")
            axes.plot(f, drawn_low[there], ":", color=Hue.INK, label="95 % of the draws")
            axes.plot(f, drawn_high[there], ":", color=Hue.INK, label="_95 % of the draws")
            titled(axes, f"|Y{SUBSCRIPTS[n]}|")
            axes.set_ylim(0, None)
        panels[0].set_ylabel("Fourier coefficient (µm)")
        legend_above(figure, panels[0], 3)
        counts = {"terms": len(one.model.terms), "draws": len(one.draws)}
        return WORDS.drawing(figure, "sampled", name=found.shown.name, **counts)
