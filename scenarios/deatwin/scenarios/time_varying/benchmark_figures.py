"""Figures of the systems whose parameters are known: after what the thesis shows before it turns to the actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.varying.maps import Map
from deatwin.ident.narx import Term
from deatwin.scenarios.time_varying.benchmark import LINES, ORDERS, Benchmark, Followed
from deatwin.scenarios.time_varying.figure_parts import (
    AFTER,
    BEFORE,
    INK,
    MARK,
    MEASURED,
    Columns,
    draw_band,
    draw_map,
    filled,
    ink_on,
    map_columns,
    share_bar,
)
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import draw, legend_above

Array = NDArray[np.float64]
QUANTILE = 1.959963984540054
"""Of the normal law, 97.5 %."""
EVERY = 20
"""Of the samples of a trajectory so many are passed over where it is drawn."""
OF_ORDER = {1: AFTER, 2: BEFORE, 3: MARK}


def benchmark_drawings(benchmark: Benchmark) -> list[tuple[Drawing, Columns]]:
    """Draw all figures of the benchmark systems."""
    linear, quadratic = benchmark.followed
    return [
        _parameters(benchmark.followed),
        _maps(
            linear,
            ["H1"],
            "resonance",
            "TV-GFRF of a linear system whose resonance travels",
            "The response of each time to a tone, were the parameters to stay: above the true one, below that found.",
        ),
        _maps(
            quadratic,
            list(LINES),
            "moving_gfrf",
            "TV-GFRFs of a quadratic system of which only the constant changes",
            "Orders one and two along f₂ = f₁, where the output has twice the frequency, and along f₂ = −f₁, where it "
            "has none. Above as they are, below from the smoother. No parameter of these orders moves: what changes "
            "them is the equilibrium.",
        ),
        _maps(
            quadratic,
            [f"G{n}" for n in ORDERS],
            "moving_nofrf",
            "TV-NOFRFs of the same system",
            "For a test signal with equal lines from 0.1 to 1 Hz: Gₙ is where its n-th power has lines.",
        ),
        _dc(benchmark),
        _frozen(benchmark),
        _coverage(benchmark),
    ]


def _parameters(followed: Sequence[Followed]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = figure.subplots(4, 2, sharex=True, squeeze=False)
        for column, one in zip(panels.T, followed, strict=True):
            found, key = one.trajectory, one.name.replace(" ", "_")
            places = one.truth.timepts.size - found.timepts.size + np.arange(0, found.timepts.size, EVERY)
            timepts = one.truth.timepts[places]
            columns[f"{key}_time_s"] = timepts
            for axes, term, theta, std, true in zip(
                column, found.terms, found.theta, found.std, one.truth.theta, strict=False
            ):
                half = QUANTILE * std[::EVERY]
                draw_band(axes, timepts, theta[::EVERY], half, AFTER, "smoother, 95 % band")
                axes.plot(timepts, true[places], color=INK, linewidth=1.0, linestyle="--", label="truth")
                axes.set_title(f"{one.name}: {_written(term)}", loc="left", fontsize="small")
                columns |= {
                    f"{key}_{term}": theta[::EVERY],
                    f"{key}_{term}_half": half,
                    f"{key}_{term}_truth": true[places],
                }
                low, high = axes.get_ylim()
                if high - low < 0.1 * abs(high):  # a parameter that stands still is not to look as if it moved
                    axes.set_ylim(0.95 * np.mean([low, high]), 1.05 * np.mean([low, high]))
            for axes in column[len(found.terms) :]:
                axes.set_visible(False)
            column[len(found.terms) - 1].set_xlabel("time (s)")
            column[len(found.terms) - 1].tick_params(labelbottom=True)
        legend_above(figure, panels[0, 0], 2)
        drawing = Drawing.of(
            figure,
            "parameters",
            "Parameters along time, found and true",
            "Left the linear system, right the quadratic one. Kalman smoother of random walks; drift variances from "
            "the posterior mode, so that none is taken for zero. The parameters that move are no random walks.",
        )
    return drawing, filled(columns)


def _written(term: Term) -> str:
    return "constant" if term == Term(()) else str(term)


def _maps(one: Followed, names: Sequence[str], key: str, title: str, caption: str) -> tuple[Drawing, Columns]:
    from matplotlib.colors import LogNorm

    columns: dict[str, Array] = {}
    with draw((9.6 if len(names) > 1 else 6.4, 5.0)) as figure:
        panels = figure.subplots(2, len(names), sharex=True, sharey="col", squeeze=False)
        for column, name in zip(panels.T, names, strict=True):
            sides = (one.true[name], one.found[name])
            gains = np.concatenate([side.gain.ravel() for side in sides])
            norm = LogNorm(float(np.quantile(gains, 0.001)), float(gains.max()))
            for axes, side, word in zip(column, sides, ("true", "found"), strict=True):
                mesh = _on_lines(axes, side, norm=norm)
                axes.set_title(f"{symbol_of(name)}, {word}", loc="left", fontsize="medium")
            column[-1].set_xlabel("time (s)")
            share_bar(figure, mesh, column, "gain")
            true = sides[0]
            columns |= map_columns(
                plain_name(name), true.timepts, true.frequencies, true_gain=true.gain, found_gain=sides[1].gain
            )
        for axes in panels[:, 0]:
            axes.set_ylabel("f₁ (Hz)" if "H2, f2 = f1" in names else "frequency (Hz)")
        drawing = Drawing.of(figure, key, title, caption)
    return drawing, filled(columns)


def _on_lines(axes: Any, side: Map, **how: Any) -> Any:
    return draw_map(axes, side.timepts, side.frequencies, side.gain, **how)


def _dc(benchmark: Benchmark) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 3.6)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        first = benchmark.solved[1]
        left.plot(first.timepts, first.equilibria, color=INK, label="solved for at each time")
        left.plot(first.timepts, benchmark.held[1].equilibria, color=MEASURED, linestyle="--", label="held")
        left.set(xlabel="time (s)", ylabel="equilibrium")
        left.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        columns |= {"time_s": first.timepts, "equilibrium": first.equilibria}
        for order in ORDERS:
            solved, held = benchmark.solved[order], benchmark.held[order]
            for side, style, word in ((solved, "-", "solved"), (held, "--", "held")):
                change = 20 * np.log10(side.gain[:, 0] / held.gain[0, 0])
                right.plot(side.timepts, change, style, color=OF_ORDER[order], label=f"$H_{order}$, {word}")
                columns[f"H{order}_{word}_dB"] = change
        right.set(xlabel="time (s)", ylabel="gain at 0.1 Hz (dB over the first)")
        right.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        drawing = Drawing.of(
            figure,
            "moving_dc",
            "What a DC component that moves does to every order",
            "The quadratic system of which only the constant drifts. Solid: the equilibrium solved for at each time "
            "and the model expanded about it. Dashed: the same drift, with the equilibrium kept where it was at first; "
            "nothing is seen to change, and all of it is wrong.",
        )
    return drawing, columns


def _frozen(benchmark: Benchmark) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    kinds = sorted({(run.system, run.response) for run in benchmark.frozen})
    with draw((9.6, 3.8)) as figure:
        panels = figure.subplots(1, len(kinds), sharex=True, sharey=True, squeeze=False)[0]
        for axes, (system, response) in zip(panels, kinds, strict=True):
            runs = [run for run in benchmark.frozen if (run.system, run.response) == (system, response)]
            speed = np.array([run.speed for run in runs])
            key = f"{system} {plain_name(response)}".replace(" ", "_")
            columns["speed"] = speed
            for name, style, colour, word in (
                ("error", "o-", INK, "error of frozen time"),
                ("estimate", "x--", BEFORE, "its estimate"),
                ("corrected", "s-", AFTER, "left after correction"),
            ):
                values = 100 * np.array([getattr(run, name) for run in runs])
                axes.plot(speed, values, style, color=colour, markersize=4, label=word)
                columns[f"{key}_{name}_percent"] = values
            axes.set(xscale="log", yscale="log", xlabel="cycles of the parameters in 300 s")
            axes.set_xticks(speed[::2], [f"{v:g}" for v in speed[::2]])
            axes.set_xticks([], minor=True)
            axes.set_title(f"{system}, {symbol_of(response)}", loc="left", fontsize="small")
        panels[0].set_ylabel("error over the response (%, rms)")
        legend_above(figure, panels[0], 3)
        drawing = Drawing.of(
            figure,
            "frozen",
            "Frozen time against the rate of variation",
            "The system that varies is probed by tones, in simulation; frozen time is the response of the parameters "
            "of the instant. Its error grows with the rate, and the estimate tells it; what is left after the "
            "correction to first order grows with the square of the rate. Past a tenth of the response the estimate is "
            "too large, and the correction no longer one.",
        )
    return drawing, columns


def _coverage(benchmark: Benchmark) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    count = len(benchmark.coverage[1])
    with draw((9.6, 3.6)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        places = np.arange(benchmark.coverage_Hz.size)
        for axes, (order, held) in zip(panels, benchmark.coverage.items(), strict=True):
            share = 100 * held.mean(axis=0)
            mesh = draw_map(
                axes, benchmark.coverage_times, places.astype(float), share, vmin=85.0, vmax=100.0, cmap="cividis"
            )
            for i, time in enumerate(benchmark.coverage_times):
                for j in places:
                    axes.text(
                        time,
                        j,
                        f"{share[i, j]:.0f}",
                        ha="center",
                        va="center",
                        fontsize=7,
                        color=ink_on(mesh, share[i, j]),
                    )
            axes.set_yticks(places, [f"{f:g}" for f in benchmark.coverage_Hz])
            name = "$H_1$" if order == 1 else "$H_2$, f₂ = f₁"
            axes.set_title(f"{name}: {share.mean():.1f} % on average", loc="left", fontsize="medium")
            axes.set_xlabel("time (s)")
            columns |= map_columns(f"H{order}", benchmark.coverage_times, benchmark.coverage_Hz, covered_percent=share)
        panels[0].set_ylabel("frequency (Hz)")
        share_bar(figure, mesh, panels, "truth covered (%)")
        drawing = Drawing.of(
            figure,
            "coverage",
            "How often the 95 % ellipses hold the truth",
            f"{count} realisations of parameters that walk at random as the smoother takes them to. Each number is of "
            f"{count} trials: chance alone moves it by ±{196 * np.sqrt(0.95 * 0.05 / count):.0f} %.",
        )
    return drawing, columns


def symbol_of(name: str) -> str:
    """Return what a response is called in a title, as H₂ along a line, or G₂."""
    symbol, *line = name.split(", ")
    written = f"${symbol[0]}_{symbol[1]}$"
    return f"{written}, {line[0].replace('f2', 'f₂').replace('f1', 'f₁').replace('-', '−')}" if line else written


def plain_name(name: str) -> str:
    """Return the same for names of columns."""
    return {"H2, f2 = f1": "H2_sum", "H2, f2 = -f1": "H2_difference"}.get(name, name)
