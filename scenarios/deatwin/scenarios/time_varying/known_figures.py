"""Figures of the systems whose parameters are known: after what the thesis shows before it turns to the actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Term
from deatwin.scenarios.time_varying.known import ORDERS, Followed, FrozenRun, Known
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, draw_between, draw_map, filled, ink_on, panels_of, share_bar, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

Array = NDArray[np.float64]
WORDS = Words(__package__)
QUANTILE = 1.959963984540054
"""97.5 % quantile of the normal law."""
EVERY = 20
"""Every so many samples of a trajectory are drawn."""
OF_ORDER = {1: Hue.AFTER, 2: Hue.BEFORE, 3: Hue.MARK}


def known_drawings(known: Known) -> list[Drawing]:
    """Draw all figures of the benchmark systems."""
    return [_parameters(known.followed), _dc(known), _frozen(known.frozen), _coverage(known)]


def map_columns(prefix: str, timepts: Array, frequencies: Array, **values: Array) -> dict[str, Array]:
    """Columns of maps on one grid, time by time. Shapes: `timepts` (n_times,); `frequencies` (n,); `**values`
    (n_times, n); returns (n_times n,).
    """
    columns = {
        f"{prefix}_time_s": np.repeat(timepts, frequencies.size),
        f"{prefix}_frequency_Hz": np.tile(frequencies, timepts.size),
    }
    return columns | {f"{prefix}_{name}": each.ravel() for name, each in values.items()}


def symbol_of(name: str) -> str:
    """A response in a title, as H₂ along a line, or G₂."""
    symbol, *line = name.split(", ")
    written = f"${symbol[0]}_{symbol[1]}$"
    return f"{written}, {line[0].replace('f2', 'f₂').replace('f1', 'f₁').replace('-', '−')}" if line else written


def plain_name(name: str) -> str:
    """A response in the names of columns."""
    return {"H2, f2 = f1": "H2_sum", "H2, f2 = -f1": "H2_difference"}.get(name, name)


def _parameters(followed: Sequence[Followed]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = panels_of(figure, 4, 2, sharex=True)
        for column, one in zip(panels.T, followed, strict=True):
            found, key = one.trajectory, one.name.replace(" ", "_")
            places = one.truth.timepts.size - found.timepts.size + np.arange(0, found.timepts.size, EVERY)
            timepts = one.truth.timepts[places]
            columns[f"{key}_time_s"] = timepts
            every = zip(column, found.terms, found.theta, found.std, one.truth.theta, strict=False)
            for axes, term, whole, std, whole_truth in every:
                theta, half, truth = whole[::EVERY], QUANTILE * std[::EVERY], whole_truth[places]
                draw_between(axes, timepts, theta - half, theta + half, Hue.AFTER)
                axes.plot(timepts, theta, color=Hue.AFTER, linewidth=1.2, label="smoother, 95 % band")
                axes.plot(timepts, truth, color=Hue.INK, linewidth=1.0, linestyle="--", label="truth")
                titled(axes, f"{one.name}: {'constant' if term == Term(()) else term}", "small")
                columns |= {f"{key}_{term}": theta, f"{key}_{term}_half": half, f"{key}_{term}_truth": truth}
                low, high = axes.get_ylim()
                if high - low < 0.1 * abs(high):  # a parameter that stands still is not to look as if it moved
                    axes.set_ylim(0.95 * np.mean([low, high]), 1.05 * np.mean([low, high]))
            for axes in column[len(found.terms) :]:
                axes.set_visible(False)
            column[len(found.terms) - 1].set_xlabel("time (s)")
            column[len(found.terms) - 1].tick_params(labelbottom=True)
        legend_above(figure, panels[0, 0], 2)
        return WORDS.drawing(figure, "parameters", filled(columns))


def _dc(known: Known) -> Drawing:
    first = known.solved[1]
    columns: dict[str, Array] = {"time_s": first.timepts, "equilibrium": first.equilibria}
    with draw((9.6, 3.6)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        left.plot(first.timepts, first.equilibria, color=Hue.INK, label="solved for at each time")
        left.plot(first.timepts, known.held[1].equilibria, color=Hue.MEASURED, linestyle="--", label="held")
        left.set(xlabel="time (s)", ylabel="equilibrium")
        for order in ORDERS:
            solved, held = known.solved[order], known.held[order]
            for side, style, word in ((solved, "-", "solved"), (held, "--", "held")):
                change = 20 * np.log10(side.gain[:, 0] / held.gain[0, 0])
                right.plot(side.timepts, change, style, color=OF_ORDER[order], label=f"$H_{order}$, {word}")
                columns[f"H{order}_{word}_dB"] = change
        right.set(xlabel="time (s)", ylabel="gain at 0.1 Hz (dB over the first)")
        for axes, count in ((left, 2), (right, 3)):
            axes.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=count)
        return WORDS.drawing(figure, "moving_dc", columns)


def _frozen(every: Sequence[FrozenRun]) -> Drawing:
    columns: dict[str, Array] = {}
    kinds = sorted({(run.system, run.response) for run in every})
    styles = {
        "error": ("o-", Hue.INK, "error of frozen time"),
        "estimate": ("x--", Hue.BEFORE, "its estimate"),
        "corrected": ("s-", Hue.AFTER, "left after correction"),
    }
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, len(kinds), "cycles of the parameters in 300 s", sharex=True, sharey=True)[0]
        for axes, (system, response) in zip(panels, kinds, strict=True):
            runs = [run for run in every if (run.system, run.response) == (system, response)]
            speed = np.array([run.speed for run in runs])
            key = f"{system} {plain_name(response)}".replace(" ", "_")
            columns["speed"] = speed
            for name, (style, colour, word) in styles.items():
                values = 100 * np.array([getattr(run, name) for run in runs])
                axes.plot(speed, values, style, color=colour, markersize=4, label=word)
                columns[f"{key}_{name}_percent"] = values
            axes.set(xscale="log", yscale="log")
            axes.set_xticks(speed[::2], [f"{v:g}" for v in speed[::2]])
            axes.set_xticks([], minor=True)
            titled(axes, f"{system}, {symbol_of(response)}", "small")
        panels[0].set_ylabel("error over the response (%, rms)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "frozen", columns)


def _coverage(known: Known) -> Drawing:
    columns: dict[str, Array] = {}
    count, times = len(known.coverage[1]), known.coverage_times
    with draw((9.6, 3.6)) as figure:
        panels = panels_of(figure, 1, 2, "time (s)", sharey=True)[0]
        places = np.arange(known.coverage_Hz.size, dtype=np.float64)
        for axes, (order, held) in zip(panels, known.coverage.items(), strict=True):
            share = 100 * held.mean(axis=0)
            mesh = draw_map(axes, times, places, share, vmin=85.0, vmax=100.0, cmap="cividis")
            for (i, j), value in np.ndenumerate(share):
                how = {"ha": "center", "va": "center", "fontsize": 7, "color": ink_on(mesh, value)}
                axes.text(times[i], places[j], f"{value:.0f}", **how)
            axes.set_yticks(places, [f"{f:g}" for f in known.coverage_Hz])
            titled(axes, f"{'$H_1$' if order == 1 else '$H_2$, f₂ = f₁'}: {share.mean():.1f} % on average")
            columns |= map_columns(f"H{order}", times, known.coverage_Hz, covered_percent=share)
        panels[0].set_ylabel("frequency (Hz)")
        share_bar(figure, mesh, panels, "truth covered (%)")
        chance = 196 * np.sqrt(0.95 * 0.05 / count)
        return WORDS.drawing(figure, "coverage", columns, count=count, chance=chance)
