"""Figures of the actuators: drifts before any fit, parameters along time, what they are worth, and maps over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import moving_mean
from deatwin.ident.frequency import remove_dc
from deatwin.ident.frequency.varying.short_time import BANDS
from deatwin.ident.narx import Term
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT
from deatwin.ident.narx.wander import CONSTANT, LIKELIEST, REFINED, SHARES, VARYING
from deatwin.scenarios.time_varying.known import LINES, ORDERS
from deatwin.scenarios.time_varying.known_figures import QUANTILE, map_columns, plain_name, symbol_of
from deatwin.scenarios.time_varying.study import LEVEL, Driven, Study
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import (
    STYLES,
    Hue,
    complete,
    draw_between,
    draw_map,
    filled,
    key_of,
    panels_of,
    share_bar,
    titled,
)
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

Array = NDArray[np.float64]
WORDS = Words(__package__)
OF_WAY = {CONSTANT: Hue.BEFORE, REFINED: Hue.MARK, VARYING: Hue.AFTER, LIKELIEST: Hue.MEASURED}
SPREAD = 20.0
"""Window of the moving mean of free-run errors, s."""
PARAMETER_COLUMNS = 4
DRAWN_DEGREE = 3
"""Largest degree of the terms whose parameters are drawn."""
MICRO = 1e6
DYNAMIC_DB = 60.0
CLEAR = 0.95
"""Share of a map within its colours: beside a notch that moves changes have no bound."""
HIGHEST_HZ = 3.0
"""Largest frequency of the spectra that are drawn."""


def fleet_drawings(study: Study) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [
        _sliding(study),
        _wander(study.driven),
        _parameters(study.shown),
        _equilibria(study.driven),
        _free_runs(study.driven),
        _bands(study.driven),
        _changes(study.shown, list(LINES), "tv_gfrf"),
        _changes(study.shown, [f"G{n}" for n in ORDERS], "tv_nofrf"),
        _spectra(study.shown),
    ]


def _sliding(study: Study) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 8.4)) as figure:
        panels = panels_of(figure, len(study.driven), 2, "time (s)", sharex=True)
        for row, one in zip(panels, study.driven, strict=True):
            s = one.sliding
            columns["time_s"] = s.timepts
            for axes, name, p in zip(row, ("mean", "gain"), (s.p_mean, s.p_gain), strict=True):
                middle, low, high = (MICRO * getattr(s, f"{name}{end}") for end in ("", "_low", "_high"))
                draw_between(axes, s.timepts, low, high, Hue.AFTER)
                axes.plot(s.timepts, middle, color=Hue.AFTER, linewidth=1.2)
                titled(axes, f"{one.name}, {name}: {'p < 0.001' if p < 1e-3 else f'p = {p:.2g}'}", "small")
                key = f"{key_of(one.name)}_{name}_um"
                columns |= {key: middle, f"{key}_low": low, f"{key}_high": high}
        for axes, label in zip(panels[len(panels) // 2], ("mean displacement (µm)", "gain (µm/V)"), strict=True):
            axes.set_ylabel(label)
        figure.align_ylabels()
        stories = " ".join(f"{one.name}: {story}" for one, story in zip(study.driven, study.stories, strict=True))
        window = study.driven[0].sliding.window_s
        return WORDS.drawing(figure, "sliding", filled(columns), window=window, stories=stories)


def _wander(driven: Sequence[Driven]) -> Drawing:
    columns: dict[str, Array] = {"share": np.array(SHARES)}
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        for one, (colour, line) in zip(driven, STYLES, strict=True):
            choosing, place = 100 * one.track.choosing, SHARES.index(one.track.share)
            left.plot(SHARES, choosing, f"o{line}", color=colour, markersize=3, linewidth=1.0, label=one.name)
            left.plot(SHARES[place], choosing[place], "o", markersize=10, fillstyle="none", color=colour)
            columns[f"{key_of(one.name)}_choosing_percent"] = choosing
        left.set(xscale="log", xlabel="share by which a term may vary", ylabel="free-run error, choosing blocks (%)")
        left.set_xticks(SHARES, [f"{share:g}" for share in SHARES])
        left.set_xticks([], minor=True)
        left.legend(fontsize="x-small", ncols=2, markerscale=1, handlelength=3)
        bars = [("unseen", way, "blocks left out", "") for way in (CONSTANT, REFINED, VARYING, LIKELIEST)]
        bars += [("ahead", way, "blocks ahead", "///") for way in (CONSTANT, VARYING)]
        places, width = np.arange(len(driven)), 0.15
        for number, (kind, way, where, hatch) in enumerate(bars):
            values, label = 100 * np.array([getattr(one.track, kind)[way] for one in driven]), f"{way}, {where}"
            how = {"color": OF_WAY[way], "hatch": hatch, "edgecolor": Hue.INK, "linewidth": 0.4, "label": label}
            right.bar(places + (number - 2.5) * width, np.minimum(values, 100.0), width, **how)
            columns[label.replace(", ", "_").replace(" ", "_") + "_percent"] = values
        right.set_axisbelow(True)
        right.set_xticks(places, [one.name for one in driven])
        right.set_ylabel("free-run error over the reading's deviation (%)")
        right.set_ylim(0, 1.55 * right.get_ylim()[1])
        right.legend(fontsize="x-small", ncols=2, loc="upper left")
        return WORDS.drawing(figure, "wander", filled(columns))


def _parameters(shown: Sequence[Driven]) -> Drawing:
    columns: dict[str, Array] = {}
    sides = [(one, *_deviations(one)) for one in shown]
    terms = [term for term in sides[0][1] if term.degree <= DRAWN_DEGREE]
    rows = -(-len(terms) // PARAMETER_COLUMNS)
    with draw((9.6, 1.6 * rows)) as figure:
        label = "parameter (µm per power of a volt)"
        panels = panels_of(figure, rows, PARAMETER_COLUMNS, y=label, sharex=True).ravel()
        for (one, _, theta, deviation), colour in zip(sides, (Hue.AFTER, Hue.BEFORE, Hue.MARK), strict=False):
            timepts, key = one.equilibrium.timepts, key_of(one.name)
            columns[f"{key}_time_s"] = timepts
            for number, (axes, term) in enumerate(zip(panels, terms, strict=False)):
                scale = 1.0 if str(term).startswith("y") else MICRO
                middle, half = scale * theta[number], scale * (QUANTILE * deviation[number])
                draw_between(axes, timepts, middle - half, middle + half, colour)
                axes.plot(timepts, middle, color=colour, linewidth=1.2, label=one.name)
                written = str(term).replace("y", "v").replace("u", "w")
                titled(axes, written, "small")
                columns |= {f"{key}_{written}": middle, f"{key}_{written}_half": half}
        for axes in panels[len(terms) :]:
            axes.set_visible(False)
        for axes in panels[max(len(terms) - PARAMETER_COLUMNS, 0) : len(terms)]:
            axes.set_xlabel("time (s)")
            axes.tick_params(labelbottom=True)
        legend_above(figure, panels[0], len(shown))
        return WORDS.drawing(figure, "theta", filled(columns))


def _deviations(one: Driven) -> tuple[tuple[Term, ...], Array, Array]:
    """Terms, parameters and their standard deviations, of the models of deviations from the equilibrium."""
    times = one.equilibrium.timepts.tolist()
    models = [remove_dc(one.track.trajectory.at(time), OPERATING_INPUT) for time in times]
    theta = np.stack([model.theta for model in models], axis=1)
    return models[0].terms, theta, np.sqrt(np.stack([np.diag(model.theta_cov) for model in models], axis=1))


def _equilibria(driven: Sequence[Driven]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.0)) as figure:
        panels = panels_of(figure, 3, 2, "time (s)", "equilibrium at 2.4 V (µm)", sharex=True)
        for axes, one in zip(panels.T.ravel(), driven, strict=True):
            found, key = one.equilibrium, key_of(one.name)
            middle, half = MICRO * found.equilibria, MICRO * QUANTILE * found.equilibrium_std
            draw_between(axes, found.timepts, middle - half, middle + half, Hue.AFTER)
            axes.plot(found.timepts, middle, color=Hue.AFTER, linewidth=1.2)
            titled(axes, one.name)
            columns |= {"time_s": found.timepts, f"{key}_um": middle, f"{key}_half_um": half}
        return WORDS.drawing(figure, "equilibria", columns)


def _free_runs(driven: Sequence[Driven]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = panels_of(figure, 3, 2, "time (s)", f"free-run error, mean over {SPREAD:.0f} s (µm)", sharex=True)
        for axes, one in zip(panels.T.ravel(), driven, strict=True):
            record = one.track.recording
            step = max(1, round(2.0 / record.sample_time))
            for way in (CONSTANT, VARYING):
                error = MICRO * (record.outputs[0] - one.track.runs[way])
                mean = moving_mean(error, round(SPREAD / record.sample_time))[::step]
                axes.plot(record.timepts[::step], mean, color=OF_WAY[way], linewidth=1.1, label=f"{way} parameters")
                columns |= {"time_s": record.timepts[::step], f"{key_of(one.name)}_{way}_um": mean}
            axes.axhline(0, color=Hue.INK, linewidth=0.6)
            fits = ", ".join(f"{100 * (1 - one.track.seen[way]):.1f} % {way}" for way in (CONSTANT, VARYING))
            titled(axes, f"{one.name}: fit {fits}", "small")
        legend_above(figure, panels[0, 0], 2)
        return WORDS.drawing(figure, "free_runs", complete(columns))


def _bands(driven: Sequence[Driven]) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, len(BANDS), "actuator", sharey=True)[0]
        for axes, band in zip(panels, BANDS, strict=True):
            for way, shift in ((CONSTANT, -0.17), (VARYING, 0.17)):
                how = {"color": OF_WAY[way], "markersize": 4, "alpha": 0.7}
                for number, one in enumerate(driven, start=1):
                    ratios = one.judged.power_ratio_dB(way, band)
                    label = f"{way} parameters" if number == 1 else f"_{way}"
                    axes.plot(np.full(ratios.size, number + shift), ratios, ".", label=label, **how)
                    columns[f"{key_of(one.name)}_{way}_{band[0]:g}_to_{band[1]:g}_Hz_dB"] = ratios
            axes.axhline(0, color=Hue.INK, linewidth=0.6)
            axes.set_xticks(range(1, len(driven) + 1))
            titled(axes, f"{band[0]:g} to {band[1]:g} Hz")
        panels[0].set_yscale("symlog", linthresh=1.0)
        ticks = (-10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10)
        panels[0].set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
        panels[0].set(ylim=(-20, 20), ylabel="predicted over recorded power (dB)")
        legend_above(figure, panels[0], 2)
        return WORDS.drawing(figure, "bands", filled(columns))


def _changes(shown: Sequence[Driven], names: Sequence[str], key: str) -> Drawing:
    """Maps of how gains change along time."""
    columns: dict[str, Array] = {}
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
                prefix, values = (
                    f"{key_of(one.name)}_{plain_name(name)}",
                    {"gain_um": gain, "change_dB": found.change_dB},
                )
                columns |= map_columns(prefix, found.timepts, found.frequencies, **values)
            row[0].set_ylabel("f₁ (Hz)" if "," in name else "frequency (Hz)")
            share_bar(figure, mesh, row, "change (dB)")
        return WORDS.drawing(figure, key, filled(columns), LEVEL=LEVEL)


def _spectra(shown: Sequence[Driven]) -> Drawing:
    """Short-time spectra, recorded and predicted."""
    columns: dict[str, Array] = {}
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
            both = {"recorded_dB_um": recorded, "predicted_dB_um": predicted}
            columns |= map_columns(key_of(name), found.timepts, frequencies, **both)
        for axes in panels[:, 0]:
            axes.set_ylabel("frequency (Hz)")
        share_bar(figure, level, panels[:2].ravel().tolist(), "amplitude (dB over 1 µm)")
        share_bar(figure, change, panels[2].tolist(), "difference (dB)")
        return WORDS.drawing(figure, "short_time", filled(columns))
