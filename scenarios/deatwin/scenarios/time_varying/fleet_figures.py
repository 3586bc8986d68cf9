"""Figures of the actuators: what drifts before any fit, the parameters along time, and what they are worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import moving_mean
from deatwin.ident.frequency import remove_dc
from deatwin.ident.frequency.varying.short_time import BANDS
from deatwin.ident.narx import Term
from deatwin.ident.narx.wander import CONSTANT, LIKELIEST, REFINED, SHARES, VARYING
from deatwin.scenarios.time_varying.benchmark_figures import QUANTILE
from deatwin.scenarios.time_varying.figure_parts import AFTER, BEFORE, INK, MARK, MEASURED, Columns, draw_band, filled
from deatwin.scenarios.time_varying.study import OPERATING_INPUT, Driven, Study
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import draw, legend_above

Array = NDArray[np.float64]
OF_WAY = {CONSTANT: BEFORE, REFINED: MARK, VARYING: AFTER, LIKELIEST: MEASURED}
SPREAD = 20.0
"""Of the moving mean of free-run errors, s."""
PARAMETER_COLUMNS = 4
DRAWN_DEGREE = 3
"""Of the terms whose parameters are drawn."""
MICRO = 1e6


def fleet_drawings(study: Study) -> list[tuple[Drawing, Columns]]:
    """Draw the figures of the fleet, but for its maps."""
    return [
        _sliding(study),
        _wander(study.driven),
        _parameters(study.shown),
        _equilibria(study.driven),
        _free_runs(study.driven),
        _bands(study.driven),
    ]


def key_of(driven: Driven) -> str:
    """Name of an actuator for columns and files."""
    return driven.name.replace(" ", "")


def _sliding(study: Study) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 8.4)) as figure:
        panels = figure.subplots(len(study.driven), 2, sharex=True, squeeze=False)
        for row, one in zip(panels, study.driven, strict=True):
            s = one.sliding
            columns["time_s"] = s.timepts
            for axes, name, p in zip(row, ("mean", "gain"), (s.p_mean, s.p_gain), strict=True):
                middle, low, high = (MICRO * getattr(s, f"{name}{end}") for end in ("", "_low", "_high"))
                axes.fill_between(s.timepts, low, high, color=AFTER, alpha=0.25, linewidth=0)
                axes.plot(s.timepts, middle, color=AFTER, linewidth=1.2)
                chance = "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"
                axes.set_title(f"{one.name}, {name}: {chance}", loc="left", fontsize="small")
                columns |= {
                    f"{key_of(one)}_{name}_um{end}": v for end, v in (("", middle), ("_low", low), ("_high", high))
                }
        for axes, label in zip(panels[len(panels) // 2], ("mean displacement (µm)", "gain (µm/V)"), strict=True):
            axes.set_ylabel(label)
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.align_ylabels()
        stories = " ".join(f"{one.name}: {story}" for one, story in zip(study.driven, study.stories, strict=True))
        drawing = Drawing.of(
            figure,
            "sliding",
            "Sliding mean and gain of each recording, before any fit (thesis figure 5.5)",
            f"Windows of {study.driven[0].sliding.window_s:.0f} s with 95 % bands from the scatter within a window. "
            "The gain is the deviation of the reading over that of the command. p: chance of so much change, were the "
            f"actuator to stand still. {stories}",
        )
    return drawing, filled(columns)


def _wander(driven: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {"share": np.array(SHARES)}
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        styles = [(colour, line) for line in ("-", "--") for colour in (AFTER, BEFORE, MARK)]
        for one, (colour, line) in zip(driven, styles, strict=True):
            choosing = 100 * one.track.choosing
            left.plot(SHARES, choosing, f"o{line}", color=colour, markersize=3, linewidth=1.0, label=one.name)
            place = SHARES.index(one.track.share)
            left.plot(SHARES[place], choosing[place], "o", markersize=10, fillstyle="none", color=colour)
            columns[f"{key_of(one)}_choosing_percent"] = choosing
        left.set(xscale="log", xlabel="share by which a term may wander", ylabel="free-run error, choosing blocks (%)")
        left.set_xticks(SHARES, [f"{share:g}" for share in SHARES])
        left.set_xticks([], minor=True)
        left.legend(fontsize="x-small", ncols=2, markerscale=1, handlelength=3)
        places, width = np.arange(len(driven)), 0.15
        left_out, ahead = (CONSTANT, REFINED, VARYING, LIKELIEST), (CONSTANT, VARYING)
        bars = [
            (f"{way}, blocks left out", [one.track.unseen[way] for one in driven], OF_WAY[way], "") for way in left_out
        ]
        bars += [
            (f"{way}, blocks ahead", [one.track.ahead[way] for one in driven], OF_WAY[way], "///") for way in ahead
        ]
        for number, (label, errors, colour, hatch) in enumerate(bars):
            values = 100 * np.array(errors)
            right.bar(
                places + (number - 2.5) * width,
                np.minimum(values, 100.0),
                width,
                color=colour,
                hatch=hatch,
                edgecolor=INK,
                linewidth=0.4,
                label=label,
            )
            columns[label.replace(", ", "_").replace(" ", "_") + "_percent"] = values
        right.set_axisbelow(True)
        right.set_xticks(places, [one.name for one in driven])
        right.set_ylabel("free-run error over the reading's deviation (%)")
        right.set_ylim(0, 1.55 * right.get_ylim()[1])
        right.legend(fontsize="x-small", ncols=2, loc="upper left")
        drawing = Drawing.of(
            figure,
            "wander",
            "How far the parameters may wander, and what they are worth on unseen samples",
            "Left: free-run error on blocks that serve for choosing, of parameters that saw neither these nor those "
            "for judging; circle: taken. Right: on every fourth block of 20 s, with parameters of the other three "
            "(plain), and on each block with parameters of what came before it (hatched). “Likeliest”: the walk's "
            "variances by maximum likelihood, which follows whatever the structure does not hold.",
        )
    return drawing, filled(columns)


def _parameters(shown: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    sides = [(one, *_deviations(one)) for one in shown]
    terms = [term for term in sides[0][2] if term.degree <= DRAWN_DEGREE]
    rows = -(-len(terms) // PARAMETER_COLUMNS)
    with draw((9.6, 1.6 * rows)) as figure:
        panels = figure.subplots(rows, PARAMETER_COLUMNS, sharex=True, squeeze=False).ravel()
        for (one, timepts, _, theta, half), colour in zip(sides, (AFTER, BEFORE, MARK), strict=False):
            columns[f"{key_of(one)}_time_s"] = timepts
            for number, (axes, term) in enumerate(zip(panels, terms, strict=False)):
                scale = 1.0 if str(term).startswith("y") else MICRO
                draw_band(axes, timepts, scale * theta[number], scale * half[number], colour, one.name)
                written = str(term).replace("y", "v").replace("u", "w")
                axes.set_title(written, loc="left", fontsize="small")
                columns |= {
                    f"{key_of(one)}_{written}": scale * theta[number],
                    f"{key_of(one)}_{written}_half": scale * half[number],
                }
        for axes in panels[len(terms) :]:
            axes.set_visible(False)
        for axes in panels[max(len(terms) - PARAMETER_COLUMNS, 0) : len(terms)]:
            axes.set_xlabel("time (s)")
            axes.tick_params(labelbottom=True)
        figure.supylabel("parameter (µm per power of a volt)", fontsize="medium")
        legend_above(figure, panels[0], len(shown))
        drawing = Drawing.of(
            figure,
            "theta",
            "Parameters along the record, the DC component removed at each instant",
            "Of the models of the deviations v and w from the equilibrium of each time at 2.4 V (v(k−1) without unit), "
            "up to the third degree of five. The parameters of the raw powers of the command are nearly collinear and "
            "say little one by one; these are sums of them. The bands, of two standard deviations, take the one-step "
            "residual for white noise: it is mostly the structure's own misfit, so that they are no more than a "
            "measure of what the walk lets the samples say.",
        )
    return drawing, filled(columns)


def _deviations(one: Driven) -> tuple[Array, tuple[Term, ...], Array, Array]:
    """Times, terms, parameters and half the width of their bands, of the models of deviations from the equilibrium."""
    timepts = one.equilibrium.timepts
    models = [remove_dc(one.track.trajectory.at(time), OPERATING_INPUT) for time in timepts.tolist()]
    theta = np.stack([model.theta for model in models], axis=1)
    deviation = np.sqrt(np.stack([np.diag(model.theta_cov) for model in models], axis=1))
    return timepts, models[0].terms, theta, QUANTILE * deviation


def _equilibria(driven: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.0)) as figure:
        panels = figure.subplots(3, 2, sharex=True)
        for axes, one in zip(panels.T.ravel(), driven, strict=True):
            found = one.equilibrium
            middle, half = MICRO * found.equilibria, MICRO * QUANTILE * found.equilibrium_std
            draw_band(axes, found.timepts, middle, half, AFTER, "equilibrium")
            axes.set_title(one.name, loc="left", fontsize="medium")
            columns |= {"time_s": found.timepts, f"{key_of(one)}_um": middle, f"{key_of(one)}_half_um": half}
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel("equilibrium at 2.4 V (µm)", fontsize="medium")
        drawing = Drawing.of(
            figure,
            "equilibria",
            "The equilibrium along time (as the thesis' appendix C shows it)",
            "Solved for at each time with the parameters of that time, at the mean of the command.",
        )
    return drawing, columns


def _free_runs(driven: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = figure.subplots(3, 2, sharex=True)
        for axes, one in zip(panels.T.ravel(), driven, strict=True):
            record = one.track.recording
            step = max(1, round(2.0 / record.sample_time))
            for way in (CONSTANT, VARYING):
                error = MICRO * (record.outputs[0] - one.track.runs[way])
                mean = moving_mean(error, round(SPREAD / record.sample_time))[::step]
                axes.plot(record.timepts[::step], mean, color=OF_WAY[way], linewidth=1.1, label=f"{way} parameters")
                columns |= {"time_s": record.timepts[::step], f"{key_of(one)}_{way}_um": mean}
            axes.axhline(0, color=INK, linewidth=0.6)
            seen = {way: 100 * (1 - one.track.seen[way]) for way in (CONSTANT, VARYING)}
            axes.set_title(
                f"{one.name}: fit {seen[CONSTANT]:.1f} % constant, {seen[VARYING]:.1f} % varying",
                loc="left",
                fontsize="small",
            )
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel(f"free-run error, mean over {SPREAD:.0f} s (µm)", fontsize="medium")
        legend_above(figure, panels[0, 0], 2)
        drawing = Drawing.of(
            figure,
            "free_runs",
            "Free runs over the whole recordings, constant parameters and varying ones",
            "One run each, from the first sample on, of parameters estimated on the same recording: what is left is to "
            "be read with the errors on unseen blocks.",
        )
    complete = np.all([np.isfinite(c) for c in columns.values()], axis=0)
    return drawing, {name: column[complete] for name, column in columns.items()}


def _bands(driven: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 3.8)) as figure:
        panels = figure.subplots(1, len(BANDS), sharey=True)
        for axes, band in zip(panels, BANDS, strict=True):
            for way, shift in ((CONSTANT, -0.17), (VARYING, 0.17)):
                for number, one in enumerate(driven, start=1):
                    ratios = one.judged.power_ratio_dB(way, band)
                    axes.plot(
                        np.full(ratios.size, number + shift),
                        ratios,
                        ".",
                        color=OF_WAY[way],
                        markersize=4,
                        alpha=0.7,
                        label=f"{way} parameters" if number == 1 else f"_{way}",
                    )
                    columns[f"{key_of(one)}_{way}_{band[0]:g}_to_{band[1]:g}_Hz_dB"] = ratios
            axes.axhline(0, color=INK, linewidth=0.6)
            axes.set_xticks(range(1, len(driven) + 1))
            axes.set_title(f"{band[0]:g} to {band[1]:g} Hz", loc="left", fontsize="medium")
            axes.set_xlabel("actuator")
        panels[0].set_yscale("symlog", linthresh=1.0)
        ticks = (-10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10)
        panels[0].set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
        panels[0].set_ylim(-20, 20)
        panels[0].set_ylabel("predicted over recorded power (dB)")
        legend_above(figure, panels[0], 2)
        drawing = Drawing.of(
            figure,
            "bands",
            "Power of the output by band, predicted and recorded, in windows that no fit saw",
            "A point for each of the blocks of 20 s that were left out. The command has lines up to 1 Hz; what is "
            "above is the nonlinearity's. The axis is linear up to 1 dB.",
        )
    return drawing, filled(columns)
