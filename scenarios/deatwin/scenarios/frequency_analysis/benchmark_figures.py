"""The figures of the benchmark systems, in place of figures 4.2, 4.4, 4.5 and 6.10 of the thesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.closed_forms import DUFFING, QUADRATIC
from deatwin.scenarios.frequency_analysis.benchmarks import Benchmarks, Evaluated, Identified, Ranges
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
OF_ORDER = (AFTER, BEFORE, MARK)
SMALLEST = 1e-10
"""Share of the largest line below which rounding is drawn no more."""
HELD = 0.1
"""Third frequency of the slice of H_3, Hz: near the resonance."""
SUBSCRIPTS = "₀₁₂₃₄₅₆₇₈"


def benchmark_drawings(found: Benchmarks) -> list[tuple[Drawing, Columns]]:
    """Draw what was done with the benchmark systems."""
    return [_ranges(found.ranges), _gfrfs(), _nofrfs(found.evaluated), _identified(found.identified)]


def filled(columns: Columns) -> Columns:
    """Make columns of one length: the shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}


def map_of(axes: Axes, axis: Array, decibels: Array, levels: Array) -> object:
    """Draw a gain over two frequencies. Shapes: `axis` (n,); `decibels` (n * n,)."""
    drawn = axes.contourf(axis, axis, decibels.reshape(axis.size, axis.size).T, levels=levels, cmap="viridis")
    axes.set_aspect("equal")
    axes.grid(False)
    return drawn


def _ranges(found: Sequence[Ranges]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 4.6)) as figure:
        panels = figure.subplots(1, len(found), sharey=True)
        for axes, one in zip(panels, found, strict=True):
            size = np.abs(one.simulated).max()
            key = one.system.name
            columns |= {"frequency_Hz": one.frequency_Hz, f"{key}_simulated": np.abs(one.simulated)}
            for place, (order, bands) in enumerate(zip(one.orders, one.bands_Hz, strict=True)):
                colour, n = OF_ORDER[place], place + 1
                for low, high in bands:
                    y = 2e-11 * 3.0 ** (len(one.orders) - n)
                    axes.hlines(size * y, low - 1e-3, high + 1e-3, color=colour, linewidth=4)
                gain = np.where(order.gain > SMALLEST * size, order.gain, np.nan)
                axes.plot(one.frequency_Hz, gain, "o", color=colour, markersize=3, label=f"order {n}, bar: its range")
                columns[f"{key}_Y{n}"] = order.gain
            there = np.abs(one.simulated) > SMALLEST * size
            axes.plot(
                one.frequency_Hz[there],
                np.abs(one.simulated)[there],
                "s",
                color=INK,
                fillstyle="none",
                markersize=6,
                markeredgewidth=0.6,
                label="simulated",
            )
            axes.set(yscale="log", ylim=(5e-12 * size, 4 * size), xlabel="frequency (Hz)")
            axes.set_title(f"{one.system.name}: {one.system.shown}", loc="left", fontsize="medium")
        panels[0].set_ylabel("Fourier coefficient of the output")
        legend_above(figure, panels[0], 4)
        low, high = found[0].signal.band_Hz
        drawing = Drawing.of(
            figure,
            "ranges",
            "Where the orders of an output have energy (in place of thesis figure 4.2)",
            f"The input holds {low:g} to {high:g} Hz at a sample time of 1 s. Order n reaches sums of n input "
            "frequencies of either sign, and nothing else. S2 has three orders. The Duffing oscillator has the odd "
            "ones, all of them: what is simulated beyond order 3 is of the fifth and later.",
        )
    return drawing, columns


def _gfrfs() -> tuple[Drawing, Columns]:
    """|H_1|, |H_2| and |H_3| of the two systems without a highest order."""
    axis, line = np.linspace(-0.5, 0.5, 81), np.linspace(0.002, 0.5, 250)
    grid = frequency_grid(axis, axis)
    third = np.column_stack([grid, np.full(len(grid), HELD)])
    columns: dict[str, Array] = {"f1_Hz": grid[:, 0], "f2_Hz": grid[:, 1]}
    with draw((9.6, 3.8)) as figure:
        left, *maps = figure.subplots(1, 3)
        for system, colour in ((QUADRATIC, AFTER), (DUFFING, BEFORE)):
            gain = gfrf(system.model, 1, 2 * np.pi * line).gain
            left.plot(line, gain, color=colour, label=f"{system.name}: {system.shown}")
            columns |= {"f_Hz": line, f"{system.name}_H1": gain}
        left.set(yscale="log", xlabel="frequency (Hz)", ylabel="|H₁|")
        for axes, system, order, points in ((maps[0], QUADRATIC, 2, grid), (maps[1], DUFFING, 3, third)):
            gain = gfrf(system.model, order, 2 * np.pi * points).gain
            columns[f"{system.name}_H{order}"] = gain
            decibels = 20 * np.log10(gain)
            _colours(figure, axes, axis, decibels, f"|H{SUBSCRIPTS[order]}| (dB)")
            held = f", f₃ = {HELD:g} Hz" if order == 3 else ""
            axes.set_title(f"{system.name}{held}", loc="left", fontsize="medium")
        legend_above(figure, left, 2)
        drawing = Drawing.of(
            figure,
            "benchmark_gfrfs",
            "Frequency responses of two systems (in place of thesis figure 4.4)",
            "Of the overdamped system the second order is largest where the sum of the frequencies is small, for there "
            "its pole is slow, and where both are small. Of the oscillator the third order is large where one of the "
            "three frequencies, or their sum, is at the resonance. Sample time 1 s.",
        )
    return drawing, filled(columns)


def _colours(figure: Figure, axes: Axes, axis: Array, decibels: Array, label: str) -> None:
    from matplotlib.ticker import MaxNLocator

    levels = np.asarray(MaxNLocator(14).tick_values(decibels.min(), decibels.max()), dtype=np.float64)
    figure.colorbar(map_of(axes, axis, decibels, levels), ax=axes, label=label, shrink=0.75)  # type: ignore[arg-type]
    axes.set(xlabel="f₁ (Hz)", ylabel="f₂ (Hz)")


def _nofrfs(found: Sequence[Evaluated]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 5.4)) as figure:
        rows = figure.subplots(len(found), 3, sharex=True)
        for row, one in zip(rows, found, strict=True):
            for place, axes in enumerate(row):
                n, direct, fitted = place + 1, one.direct[place], one.fitted.orders[place]
                key = f"{one.system.name}_G{n}"
                columns |= {
                    f"{key}_frequency_Hz": direct.frequency_Hz,
                    f"{key}_direct": direct.gain,
                    f"{key}_least_squares": fitted.gain,
                }
                axes.plot(direct.frequency_Hz, direct.gain, color=OF_ORDER[place], label="from the model")
                axes.plot(fitted.frequency_Hz, fitted.gain, ".", color=INK, markersize=2.5, label="least squares")
                axes.axvline(n * one.signal.band_Hz[1], color=MEASURED, linestyle=":", label="end of its range")
                axes.set_title(f"{one.system.name}: |G{SUBSCRIPTS[n]}|", loc="left", fontsize="medium")
                if not direct.gain.any():
                    axes.set_ylim(-0.05, 1.0)
                else:
                    axes.set_ylim(0, None)
        for axes in rows[-1]:
            axes.set_xlabel("frequency (Hz)")
        legend_above(figure, rows[0, 0], 3)
        drawing = Drawing.of(
            figure,
            "benchmark_nofrfs",
            "NOFRFs of two systems (in place of thesis figure 4.5)",
            "By least squares over levels of the test signal, and directly. G₁ is H₁; the others are means of Hₙ over "
            "all ways to reach a frequency. The oscillator has no even orders.",
        )
    return drawing, filled(columns)


def _identified(one: Identified) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {"frequency_Hz": one.orders[0].frequency_Hz}
    with draw((9.6, 5.0)) as figure:
        panels, errors = figure.subplots(2, 3, sharex="col")
        for place, (axes, relative) in enumerate(zip(panels, errors, strict=True)):
            n, found, truth = place + 1, one.orders[place], one.true_orders[place]
            there = truth.gain > 1e-9 * truth.gain.max()
            f, band = found.frequency_Hz, found.band()
            low, high = (100 * (side[there] - truth.gain[there]) / truth.gain.max() for side in (band.low, band.high))
            relative.fill_between(f[there], low, high, color=OF_ORDER[place], alpha=0.35, linewidth=0)
            relative.axhline(0, color=INK, linewidth=0.9)
            relative.set_xlabel("frequency (Hz)")
            axes.fill_between(
                f[there],
                band.low[there],
                band.high[there],
                color=OF_ORDER[place],
                alpha=0.35,
                linewidth=0,
                label="95 % band",
            )
            axes.plot(f[there], truth.gain[there], color=INK, linewidth=0.9, label="true")
            axes.set_title(f"|Y{SUBSCRIPTS[n]}|", loc="left", fontsize="medium")
            axes.set_ylim(0, None)
            columns |= {f"Y{n}": found.gain, f"Y{n}_low": band.low, f"Y{n}_high": band.high, f"Y{n}_true": truth.gain}
        panels[0].set_ylabel("Fourier coefficient")
        errors[0].set_ylabel("band less truth (% of largest)")
        legend_above(figure, panels[0], 2)
        drawing = Drawing.of(
            figure,
            "identified",
            "Orders of the output of an identified system (in place of thesis figure 6.10)",
            "S2, identified by SVB from one recording of 1000 samples, under the test signal. Below: how far the band "
            "reaches to either side of the truth, over the largest true line of the order. Over "
            f"{one.recordings} further recordings of 500 samples, fitted by least squares, the bands hold the truth at "
            f"{', '.join(f'{100 * c:.1f}' for c in one.coverage)} % of the lines.",
        )
    return drawing, columns
