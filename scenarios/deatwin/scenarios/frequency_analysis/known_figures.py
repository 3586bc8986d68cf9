"""The figures of the benchmark systems, in place of figures 4.2, 4.4, 4.5 and 6.10 of the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.closed_forms import DUFFING, QUADRATIC, ClosedForm
from deatwin.ident.frequency.output_responses.settled import Evaluated, OrderRanges
from deatwin.scenarios.frequency_analysis.known import BAND, Identified, Known
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import SUBSCRIPTS, Hue, draw_between, filled, panels_of, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Each, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
WORDS = Words(__package__)
OF_ORDER = (Hue.AFTER, Hue.BEFORE, Hue.MARK)
SMALLEST = 1e-10
"""Share of the largest line below which rounding is no longer drawn."""
HELD = 0.1
"""Third frequency of the slice of H_3, Hz: near the resonance."""


def known_drawings(known: Known) -> list[Drawing]:
    """Draw the figures of the benchmark systems."""
    return [_ranges(known.ranges), _gfrfs(), _nofrfs(known.evaluated), _identified(known.identified)]


def map_of(axes: Axes, axis: Array, decibels: Array, levels: Array) -> object:
    """Draw a gain over two frequencies. Shapes: `axis` (n,); `decibels` (n * n,)."""
    drawn = axes.contourf(axis, axis, decibels.reshape(axis.size, axis.size).T, levels=levels, cmap="viridis")
    axes.set_aspect("equal")
    axes.grid(False)
    return drawn


def _ranges(found: Mapping[ClosedForm, OrderRanges]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 4.6)) as figure:
        panels = panels_of(figure, 1, len(found), "frequency (Hz)", sharey=True)[0]
        for axes, (system, one) in zip(panels, found.items(), strict=True):
            f, simulated, key = one.frequency_Hz, np.abs(one.simulated), system.name
            size = simulated.max()
            columns |= {"frequency_Hz": f, f"{key}_simulated": simulated}
            for n, (order, bands, colour) in enumerate(zip(one.orders, one.bands_Hz, OF_ORDER, strict=True), start=1):
                height = size * 2e-11 * 3.0 ** (len(one.orders) - n)
                low, high = bands.T
                axes.hlines(np.full(low.size, height), low - 1e-3, high + 1e-3, color=colour, linewidth=4)
                gain = np.where(order.gain > SMALLEST * size, order.gain, np.nan)
                axes.plot(f, gain, "o", color=colour, markersize=3, label=f"order {n}, bar: its range")
                columns[f"{key}_Y{n}"] = order.gain
            there, hollow = simulated > SMALLEST * size, {"fillstyle": "none", "markersize": 6, "markeredgewidth": 0.6}
            axes.plot(f[there], simulated[there], "s", color=Hue.INK, label="simulated", **hollow)
            axes.set(yscale="log", ylim=(5e-12 * size, 4 * size))
            titled(axes, f"{system.name}: {system.shown}")
        panels[0].set_ylabel("Fourier coefficient of the output")
        legend_above(figure, panels[0], 4)
        low, high = next(iter(found.values())).signal.band_Hz
        return WORDS.drawing(figure, "ranges", columns, low=low, high=high)


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


def _nofrfs(found: Mapping[ClosedForm, Evaluated]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 5.4)) as figure:
        rows = panels_of(figure, len(found), 3, "frequency (Hz)", sharex=True)
        for row, (system, one) in zip(rows, found.items(), strict=True):
            for place, axes in enumerate(row):
                n, direct, fitted = place + 1, one.direct[place], one.fitted.orders[place]
                key = f"{system.name}_G{n}"
                columns |= {
                    f"{key}_frequency_Hz": direct.frequency_Hz,
                    f"{key}_direct": direct.gain,
                    f"{key}_least_squares": fitted.gain,
                }
                axes.plot(direct.frequency_Hz, direct.gain, color=OF_ORDER[place], label="from the model")
                axes.plot(fitted.frequency_Hz, fitted.gain, ".", color=Hue.INK, markersize=2.5, label="least squares")
                axes.axvline(n * BAND[1], color=Hue.MEASURED, linestyle=":", label="end of its range")
                titled(axes, f"{system.name}: |G{SUBSCRIPTS[n]}|")
                axes.set_ylim(*((0, None) if direct.gain.any() else (-0.05, 1.0)))
        legend_above(figure, rows[0, 0], 3)
        return WORDS.drawing(figure, "benchmark_nofrfs", filled(columns))


def _identified(one: Identified) -> Drawing:
    columns: dict[str, Array] = {"frequency_Hz": one.orders[0].frequency_Hz}
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
            columns |= {f"Y{n}": found.gain, f"Y{n}_low": band.low, f"Y{n}_high": band.high, f"Y{n}_true": truth.gain}
        panels[0].set_ylabel("Fourier coefficient")
        errors[0].set_ylabel("band less truth (% of largest)")
        legend_above(figure, panels[0], 2)
        coverage = Each(100 * one.coverage)
        return WORDS.drawing(figure, "identified", columns, recordings=one.recordings, coverage=coverage)
