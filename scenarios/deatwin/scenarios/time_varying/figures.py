"""The figures: systems whose parameters are known, then the actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.frequency import remove_dc
from deatwin.ident.frequency.varying.short_time import BANDS
from deatwin.ident.narx import Term
from deatwin.ident.narx.fleet import OPERATING_INPUT
from deatwin.ident.narx.varying_systems import CONSTANT, VARYING
from deatwin.plant.arrays import Array
from deatwin.scenarios.time_varying.study import (
    COVERAGE_HZ,
    COVERAGE_TIMES,
    LEVEL,
    LINES,
    ORDERS,
    Driven,
    Followed,
    FrozenRun,
    Known,
    Study,
)
from deatwin.studies.report.drawing import (
    Drawing,
    Hue,
    draw,
    draw_between,
    draw_map,
    ink_on,
    legend_above,
    panels_of,
    share_bar,
    titled,
)
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
QUANTILE = 1.959963984540054  # 97.5 % quantile of the normal law
EVERY = 20  # Every so many samples of a trajectory are drawn
OF_ORDER = {1: Hue.AFTER, 2: Hue.BEFORE, 3: Hue.MARK}


def known_drawings(known: Known) -> list[Drawing]:
    """Draw all figures of the benchmark systems."""
    return [_known_parameters(known.followed), _dc(known), _frozen(known.frozen), _coverage(known)]


def symbol_of(name: str) -> str:
    """A response in a title, as H₂ along a line, or G₂."""
    symbol, *line = name.split(", ")
    written = f"${symbol[0]}_{symbol[1]}$"
    return f"{written}, {line[0].replace('f2', 'f₂').replace('f1', 'f₁').replace('-', '−')}" if line else written


def _known_parameters(followed: Sequence[Followed]) -> Drawing:
    with draw((9.6, 6.4)) as figure:
        panels = panels_of(figure, 4, 2, sharex=True)
        for column, one in zip(panels.T, followed, strict=True):
            found = one.trajectory
            places = one.truth.timepts.size - found.timepts.size + np.arange(0, found.timepts.size, EVERY)
            timepts = one.truth.timepts[places]
            every = zip(column, found.terms, found.theta, found.std, one.truth.theta, strict=False)
            for axes, term, whole, std, whole_truth in every:
                theta, half, truth = whole[::EVERY], QUANTILE * std[::EVERY], whole_truth[places]
                draw_between(axes, timepts, theta - half, theta + half, Hue.AFTER)
                axes.plot(timepts, theta, color=Hue.AFTER, linewidth=1.2, label="smoother, 95 % band")
                axes.plot(timepts, truth, color=Hue.INK, linewidth=1.0, linestyle="--", label="truth")
                titled(axes, f"{one.name}: {'constant' if term == Term(()) else term}", "small")
                low, high = axes.get_ylim()
                if high - low < 0.1 * abs(high):  # a parameter that stands still is not to look as if it moved
                    axes.set_ylim(0.95 * np.mean([low, high]), 1.05 * np.mean([low, high]))
            for axes in column[len(found.terms) :]:
                axes.set_visible(False)
            column[len(found.terms) - 1].set_xlabel("time (s)")
            column[len(found.terms) - 1].tick_params(labelbottom=True)
        legend_above(figure, panels[0, 0], 2)
        return WORDS.drawing(figure, "parameters")


def _dc(known: Known) -> Drawing:
    first = known.solved[1]
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
        right.set(xlabel="time (s)", ylabel="gain at 0.1 Hz (dB relative to the first)")
        for axes, count in ((left, 2), (right, 3)):
            axes.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=count)
        return WORDS.drawing(figure, "moving_dc")


def _frozen(every: Sequence[FrozenRun]) -> Drawing:
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
            for name, (style, colour, word) in styles.items():
                values = 100 * np.array([getattr(run, name) for run in runs])
                axes.plot(speed, values, style, color=colour, markersize=4, label=word)
            axes.set(xscale="log", yscale="log")
            axes.set_xticks(speed[::2], [f"{v:g}" for v in speed[::2]])
            axes.set_xticks([], minor=True)
            titled(axes, f"{system}, {symbol_of(response)}", "small")
        panels[0].set_ylabel("error relative to the response (%, rms)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "frozen")


def _coverage(known: Known) -> Drawing:
    count, times = len(known.coverage[1]), COVERAGE_TIMES
    with draw((9.6, 3.6)) as figure:
        panels = panels_of(figure, 1, 2, "time (s)", sharey=True)[0]
        places = np.arange(COVERAGE_HZ.size, dtype=np.float64)
        for axes, (order, held) in zip(panels, known.coverage.items(), strict=True):
            share = 100 * held.mean(axis=0)
            mesh = draw_map(axes, times, places, share, vmin=85.0, vmax=100.0, cmap="cividis")
            for (i, j), value in np.ndenumerate(share):
                how = {"ha": "center", "va": "center", "fontsize": 7, "color": ink_on(mesh, value)}
                axes.text(times[i], places[j], f"{value:.0f}", **how)
            axes.set_yticks(places, [f"{f:g}" for f in COVERAGE_HZ])
            titled(axes, f"{'$H_1$' if order == 1 else '$H_2$, f₂ = f₁'}: {share.mean():.1f} % on average")
        panels[0].set_ylabel("frequency (Hz)")
        share_bar(figure, mesh, panels, "truth covered (%)")
        chance = 196 * np.sqrt(0.95 * 0.05 / count)
        return WORDS.drawing(figure, "coverage", count=count, chance=chance)


OF_WAY = {CONSTANT: Hue.BEFORE, VARYING: Hue.AFTER}
PARAMETER_COLUMNS = 4
DRAWN_DEGREE = 3  # Largest degree of the terms whose parameters are drawn
MICRO = 1e6
DYNAMIC_DB = 60.0
CLEAR = 0.95  # Share of a map within its colours: beside a notch that moves changes have no bound
HIGHEST_HZ = 3.0  # Largest frequency of the spectra that are drawn


def fleet_drawings(study: Study) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [
        _sliding(study),
        _parameters(study.shown),
        _equilibria(study.driven),
        _bands(study.driven),
        _changes(study.shown, list(LINES), "tv_gfrf"),
        _changes(study.shown, [f"G{n}" for n in ORDERS], "tv_nofrf"),
        _spectra(study.shown),
    ]


def _sliding(study: Study) -> Drawing:
    with draw((9.6, 8.4)) as figure:
        panels = panels_of(figure, len(study.driven), 2, "time (s)", sharex=True)
        for row, one in zip(panels, study.driven, strict=True):
            s = one.sliding
            for axes, name, p in zip(row, ("mean", "gain"), (s.p_mean, s.p_gain), strict=True):
                middle, low, high = (MICRO * getattr(s, f"{name}{end}") for end in ("", "_low", "_high"))
                draw_between(axes, s.timepts, low, high, Hue.AFTER)
                axes.plot(s.timepts, middle, color=Hue.AFTER, linewidth=1.2)
                titled(axes, f"{one.name}, {name}: {'p < 0.001' if p < 1e-3 else f'p = {p:.2g}'}", "small")
        for axes, label in zip(panels[len(panels) // 2], ("mean displacement (µm)", "gain (µm/V)"), strict=True):
            axes.set_ylabel(label)
        figure.align_ylabels()
        stories = " ".join(f"{one.name}: {story}" for one, story in zip(study.driven, study.stories, strict=True))
        window = study.driven[0].sliding.window_s
        return WORDS.drawing(figure, "sliding", window=window, stories=stories)


def _parameters(shown: Sequence[Driven]) -> Drawing:
    sides = [(one, *_deviations(one)) for one in shown]
    terms = [term for term in sides[0][1] if term.degree <= DRAWN_DEGREE]
    rows = -(-len(terms) // PARAMETER_COLUMNS)
    with draw((9.6, 1.6 * rows)) as figure:
        label = "parameter (µm per power of a volt)"
        panels = panels_of(figure, rows, PARAMETER_COLUMNS, y=label, sharex=True).ravel()
        for (one, _, theta, deviation), colour in zip(sides, (Hue.AFTER, Hue.BEFORE, Hue.MARK), strict=False):
            timepts = one.equilibrium.timepts
            for number, (axes, term) in enumerate(zip(panels, terms, strict=False)):
                scale = 1.0 if str(term).startswith("y") else MICRO
                middle, half = scale * theta[number], scale * (QUANTILE * deviation[number])
                draw_between(axes, timepts, middle - half, middle + half, colour, f"_{one.name}")
                axes.plot(timepts, middle, color=colour, linewidth=1.2, label=one.name)
                titled(axes, str(term).replace("y", "v").replace("u", "w"), "small")
        for axes in panels[len(terms) :]:
            axes.set_visible(False)
        for axes in panels[max(len(terms) - PARAMETER_COLUMNS, 0) : len(terms)]:
            axes.set_xlabel("time (s)")
            axes.tick_params(labelbottom=True)
        legend_above(figure, panels[0], len(shown))
        return WORDS.drawing(figure, "theta")


def _deviations(one: Driven) -> tuple[tuple[Term, ...], Array, Array]:
    """Terms, parameters and their standard deviations, of the models of deviations from the equilibrium."""
    times = one.equilibrium.timepts.tolist()
    models = [remove_dc(one.track.trajectory.at(time), OPERATING_INPUT) for time in times]
    theta = np.stack([model.theta for model in models], axis=1)
    return models[0].terms, theta, np.sqrt(np.stack([np.diag(model.theta_cov) for model in models], axis=1))


def _equilibria(driven: Sequence[Driven]) -> Drawing:
    with draw((9.6, 6.0)) as figure:
        panels = panels_of(figure, 3, 2, "time (s)", "equilibrium at 2.4 V (µm)", sharex=True)
        for axes, one in zip(panels.T.ravel(), driven, strict=True):
            found = one.equilibrium
            middle, half = MICRO * found.equilibria, MICRO * QUANTILE * found.equilibrium_std
            draw_between(axes, found.timepts, middle - half, middle + half, Hue.AFTER)
            axes.plot(found.timepts, middle, color=Hue.AFTER, linewidth=1.2)
            titled(axes, one.name)
        return WORDS.drawing(figure, "equilibria")


def _bands(driven: Sequence[Driven]) -> Drawing:
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, len(BANDS), "actuator", sharey=True)[0]
        for axes, band in zip(panels, BANDS, strict=True):
            for way, shift in ((CONSTANT, -0.17), (VARYING, 0.17)):
                how = {"color": OF_WAY[way], "markersize": 4, "alpha": 0.7}
                for number, one in enumerate(driven, start=1):
                    ratios = one.judged.power_ratio_dB(way, band)
                    label = f"{way} parameters" if number == 1 else f"_{way}"
                    axes.plot(np.full(ratios.size, number + shift), ratios, ".", label=label, **how)
            axes.axhline(0, color=Hue.INK, linewidth=0.6)
            axes.set_xticks(range(1, len(driven) + 1))
            titled(axes, f"{band[0]:g} to {band[1]:g} Hz")
        panels[0].set_yscale("symlog", linthresh=1.0)
        ticks = (-10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10)
        panels[0].set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
        panels[0].set(ylim=(-20, 20), ylabel="predicted over recorded power (dB)")
        legend_above(figure, panels[0], 2)
        return WORDS.drawing(figure, "bands")


def _changes(shown: Sequence[Driven], names: Sequence[str], key: str) -> Drawing:
    """Maps of how gains change along time."""
    with draw((9.6, 2.4 * len(names))) as figure:
        panels = panels_of(figure, len(names), len(shown), "time (s)", sharex=True, sharey="row")
        for row, name in zip(panels, names, strict=True):
            largest = max(float(np.quantile(np.abs(one.maps[name].change_dB), CLEAR)) for one in shown)
            colours = {"vmin": -largest, "vmax": largest, "cmap": "RdBu_r"}
            unit = ("µm/V", "µm/V²", "µm/V³")[int(name[1]) - 1]
            for axes, one in zip(row, shown, strict=True):
                found, gain = one.maps[name], MICRO * one.maps[name].gain
                mesh = draw_map(axes, found.timepts, found.frequencies, found.change_dB, **colours)
                titled(axes, f"{one.name}, {symbol_of(name)}: {gain.min():.3g} to {gain.max():.3g} {unit}", "small")
            row[0].set_ylabel("f₁ (Hz)" if "," in name else "frequency (Hz)")
            share_bar(figure, mesh, row, "change (dB)")
        return WORDS.drawing(figure, key, LEVEL=LEVEL)


def _spectra(shown: Sequence[Driven]) -> Drawing:
    """Short-time spectra, recorded and predicted."""
    spectra = [(one.name, one.whole) for one in shown if one.whole is not None]
    with draw((9.6, 7.0)) as figure:
        panels = panels_of(figure, 3, len(spectra), "time (s)", sharex=True, sharey=True)
        for column, (name, found) in zip(panels.T, spectra, strict=True):
            inside = found.frequencies <= HIGHEST_HZ
            sides = (found.recorded, found.predicted[VARYING])
            recorded, predicted = (20 * np.log10(np.abs(side[:, inside]) + 1e-12) + 120 for side in sides)
            frequencies, top = found.frequencies[inside], float(recorded.max())
            for axes, values in zip(column, (recorded, predicted), strict=False):
                level = draw_map(axes, found.timepts, frequencies, values, vmin=top - DYNAMIC_DB, vmax=top)
            colours = {"vmin": -6.0, "vmax": 6.0, "cmap": "RdBu_r"}
            change = draw_map(column[2], found.timepts, frequencies, predicted - recorded, **colours)
            for axes, word in zip(column, ("recorded", "from TV-NOFRFs", "predicted over recorded"), strict=True):
                titled(axes, f"{name}, {word}", "small")
        for axes in panels[:, 0]:
            axes.set_ylabel("frequency (Hz)")
        share_bar(figure, level, panels[:2].ravel().tolist(), "amplitude (dB over 1 µm)")
        share_bar(figure, change, panels[2].tolist(), "difference (dB)")
        return WORDS.drawing(figure, "short_time")
