"""The figures of the fleet, after figures 4.10 to 4.12 and in place of 6.13 of the thesis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Term
from deatwin.ident.narx.fleet.alike import BAND, OPERATING_INPUT
from deatwin.scenarios.frequency_analysis.actuators import (
    FREQUENCIES,
    GRID,
    LARGE,
    MOST_ORDERS,
    ORDERS,
    SMALL,
    Actuators,
    Analysed,
    Anchor,
)
from deatwin.scenarios.frequency_analysis.known_figures import map_of
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import (
    STYLES,
    SUBSCRIPTS,
    Hue,
    draw_between,
    filled,
    key_of,
    panels_of,
    plain_numbers,
    titled,
)
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

Array = NDArray[np.float64]
WORDS = Words(__package__)
MICRO = 1e6
NOTHING = 1e-14
"""Share of a free run below which what is left of it is rounding."""
ZOOM = 20.0
"""Length of the free runs that are drawn, s."""
UNITS = ("µm/V", "µm/V²", "µm/V³")


def fleet_drawings(found: Actuators, truth: Anchor) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [
        _removal(found.shown),
        _first(found.each),
        _second(found.each),
        _test_signal(found),
        _nofrfs(found),
        _series(found),
        _sampled(found),
        _anchor(truth),
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
        columns = {"time_s": timepts, **{f"{name}_mm": values for name, values in shown.items()}}
        although = "" if Term(()) in removal.model.terms else WORDS.text("figure.removal.although")
        return WORDS.drawing(figure, "removal", columns, name=one.name, although=although)


def _first(each: Sequence[Analysed]) -> Drawing:
    columns: dict[str, Array] = {"frequency_Hz": FREQUENCIES}
    with draw((9.6, 4.2)) as figure:
        gain, phase = figure.subplots(1, 2)
        for one, (colour, line) in zip(each, STYLES, strict=False):
            response, band, key = one.first, one.first.band(), key_of(one.name)
            middle, low, high = (MICRO * values for values in (response.gain, band.low, band.high))
            draw_between(gain, FREQUENCIES, low, high, colour, alpha=0.15)
            gain.plot(FREQUENCIES, middle, color=colour, linestyle=line, label=one.name)
            phase.plot(FREQUENCIES, response.phase_deg, color=colour, linestyle=line)
            columns |= {
                f"{key}_um_per_V": middle,
                f"{key}_low": low,
                f"{key}_high": high,
                f"{key}_phase_deg": response.phase_deg,
            }
        for axes in (gain, phase):
            axes.axvspan(BAND[1], FREQUENCIES[-1], color=Hue.MEASURED, alpha=0.12, linewidth=0)
            axes.set(xscale="log", xlabel="frequency (Hz)", xlim=(FREQUENCIES[0], FREQUENCIES[-1]))
            plain_numbers(axes.xaxis)
        gain.set(ylabel="|H₁| (µm/V)", ylim=(0, None))
        phase.set_ylabel("phase (°)")
        legend_above(figure, gain, 6)
        return WORDS.drawing(figure, "gfrf1", columns, OPERATING_INPUT=OPERATING_INPUT)


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
    columns: dict[str, Array] = {"time_s": timepts, "random_V": side.random, "designed_V": equal}
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
                axes.plot(u.frequency_Hz[inside], np.abs(u.values[inside]), color=colour, marker=marker, markersize=3)
                columns |= {f"line{order}_Hz": u.frequency_Hz, f"{key}_U{order}": np.abs(u.values)}
            unit = "V" + ("", "", "²", "³")[order]
            axes.set(yscale="log", xlabel="frequency (Hz)", ylabel=f"|U{SUBSCRIPTS[order]}| ({unit})")
        outputs = {"random": (side.by_random, Hue.AFTER, 4), "designed": (side.designed, Hue.INK, 0)}
        for axes, order in zip(below[1:], (2, 3), strict=True):
            for key, (fit, colour, size) in outputs.items():
                g = fit.orders[order - 1]
                axes.plot(g.frequency_Hz, MICRO * g.gain, color=colour, marker=".", markersize=size, linewidth=0.9)
                columns |= {f"{key}_G{order}_Hz": g.frequency_Hz, f"{key}_G{order}": MICRO * g.gain}
            axes.set(yscale="log", xlabel="frequency (Hz)", xlim=(-0.1, order * BAND[1] + 0.1))
            axes.set_ylabel(f"|G{SUBSCRIPTS[order]}| ({UNITS[order - 1]})")
        legend_above(figure, left, 2)
        return WORDS.drawing(figure, "test_signal", filled(columns), name=found.shown.name)


def _nofrfs(found: Actuators) -> Drawing:
    columns: dict[str, Array] = {}
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, ORDERS, "frequency (Hz)")[0]
        for place, axes in enumerate(panels):
            n = place + 1
            for one, (colour, line) in zip(found.each, STYLES, strict=False):
                fitted, direct = one.nofrfs.fitted.orders[place], one.nofrfs.direct[place]
                axes.plot(fitted.frequency_Hz, MICRO * fitted.gain, color=colour, linestyle=line, label=one.name)
                axes.plot(direct.frequency_Hz, MICRO * direct.gain, ".", color=colour, markersize=2)
                key = f"{key_of(one.name)}_G{n}"
                columns |= {
                    f"G{n}_Hz": fitted.frequency_Hz,
                    f"{key}_least_squares": MICRO * fitted.gain,
                    f"{key}_direct": MICRO * direct.gain,
                }
            axes.set(ylabel=f"|G{SUBSCRIPTS[n]}| ({UNITS[place]})", ylim=(0, None))
        legend_above(figure, panels[0], 6)
        numbers = {"OPERATING_INPUT": OPERATING_INPUT, "highest": BAND[1], "amplitude": found.signal.amplitude}
        return WORDS.drawing(figure, "nofrfs", filled(columns), **numbers)


def _series(found: Actuators) -> Drawing:
    """Share of the free run that more and more orders leave, for two common structures."""
    orders = np.arange(1.0, MOST_ORDERS + 1)
    columns: dict[str, Array] = {"orders": orders}
    every = {"linear in the output": [one.left for one in found.each], "with products": list(found.alternative.left)}
    with draw((9.6, 3.6)) as figure:
        panels = panels_of(figure, 1, 2, "orders summed", sharey=True)[0]
        for axes, (label, left) in zip(panels, every.items(), strict=True):
            for one, values, (colour, line) in zip(found.each, left, STYLES, strict=False):
                shown = 100 * np.maximum(values, NOTHING)
                axes.plot(orders, shown, line, color=colour, marker="o", markersize=3, label=one.name)
                columns[f"{key_of(one.name)}_{label.replace(' ', '_')}_percent"] = 100 * values
            axes.set(yscale="log", xticks=orders)
            titled(axes, label)
        panels[0].set_ylabel("left of the free run (%)")
        legend_above(figure, panels[0], 6)
        return WORDS.drawing(figure, "series", columns, nothing=100 * NOTHING)


def _sampled(found: Actuators) -> Drawing:
    """Orders of the output with propagated bands, and those of drawn parameters."""
    one = found.sampled
    columns: dict[str, Array] = {"frequency_Hz": one.orders[0].frequency_Hz}
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
            axes.plot(f, drawn_high[there], ":", color=Hue.INK)
            titled(axes, f"|Y{SUBSCRIPTS[n]}|")
            axes.set_ylim(0, None)
            columns |= {
                f"Y{n}_um": gain,
                f"Y{n}_low": low,
                f"Y{n}_high": high,
                f"Y{n}_drawn_low": drawn_low,
                f"Y{n}_drawn_high": drawn_high,
            }
        panels[0].set_ylabel("Fourier coefficient (µm)")
        legend_above(figure, panels[0], 3)
        counts = {"terms": len(one.model.terms), "draws": len(one.draws)}
        return WORDS.drawing(figure, "sampled", columns, name=found.shown.name, **counts)


def _anchor(one: Anchor) -> Drawing:
    f = one.frequency_Hz
    known = {
        f"bare film, {1e3 * SMALL:.0f} mV": (one.film, Hue.INK, "o-"),
        f"with hysteresis, {1e3 * SMALL:.0f} mV": (one.small, Hue.MEASURED, "s--"),
        f"with hysteresis, {1e3 * LARGE:.0f} mV": (one.large, Hue.MEASURED, "o-"),
    }
    models = {
        "model of the bare film, least squares": (one.least_squares, Hue.MARK),
        "model of the bare film, least free-run error": (one.refined, Hue.AFTER),
        "model of the actuator": (one.recorded, Hue.BEFORE),
    }
    columns: dict[str, Array] = {"frequency_Hz": f}
    with draw((9.6, 4.2)) as figure:
        axes = figure.add_subplot()
        for label, (values, colour, style) in known.items():
            gain = MICRO * np.abs(values)
            axes.plot(f, gain, style, color=colour, markersize=4, label=f"{label} (the actuator itself)")
            columns[label.replace(" ", "_").replace(",", "")] = gain
        for label, (response, colour) in models.items():
            gain, band = MICRO * response.gain, response.band()
            axes.plot(f, gain, color=colour, linewidth=1.6, label=label)
            if response is not one.refined:  # least free-run error gives no covariance
                draw_between(axes, f, MICRO * band.low, MICRO * band.high, colour, alpha=0.15)
            columns[label.replace(" ", "_").replace(",", "")] = gain
        axes.set(xscale="log", xlabel="frequency (Hz)", ylabel="|H₁| (µm/V)")
        axes.set_ylim(0, 1.35 * MICRO * float(np.abs(one.film).max()))
        plain_numbers(axes.xaxis)
        legend_above(figure, axes, 2)
        return WORDS.drawing(figure, "anchor", columns, name=one.name, OPERATING_INPUT=OPERATING_INPUT)
