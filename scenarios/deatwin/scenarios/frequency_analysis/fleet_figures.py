"""The figures of the fleet, after figures 4.10 to 4.12 and in place of 6.13 of the thesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Term
from deatwin.ident.narx.fleet.alike import BAND, OPERATING_INPUT
from deatwin.scenarios.frequency_analysis.actuators import (
    FREQUENCIES,
    GRID,
    MOST_ORDERS,
    ORDERS,
    Actuators,
    Analysed,
    Sampled,
    Side,
)
from deatwin.scenarios.frequency_analysis.anchor import LARGE, SMALL, Anchor
from deatwin.scenarios.frequency_analysis.benchmark_figures import SUBSCRIPTS, filled, map_of
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
STYLES = tuple((colour, line) for line in ("-", "--") for colour in (AFTER, BEFORE, MARK))
"""Colour and line of each actuator."""
MICRO = 1e6
NOTHING = 1e-14
"""Share of a free run below which what is left of it is rounding."""
ZOOM = 20.0
"""Length of the free runs that are drawn, s."""
UNITS = ("µm/V", "µm/V²", "µm/V³")


def fleet_drawings(found: Actuators, truth: Anchor) -> list[tuple[Drawing, Columns]]:
    """Draw what was done with the fleet."""
    shown = next(one for one in found.each if one.name == found.sampled.name)
    return [
        _removal(shown),
        _first(found.each),
        _second(found.each),
        _test_signal(found.side, shown.name),
        _nofrfs(found.each, found.signal.amplitude),
        _series(found),
        _sampled(found.sampled),
        _anchor(truth),
    ]


def _removal(one: Analysed) -> tuple[Drawing, Columns]:
    """The free run with the DC component removed, and with the constant deleted."""
    removal = one.removal
    section = removal.section
    part = slice(0, round(ZOOM / section.sample_time))
    timepts = section.timepts[part]
    traces = {
        "measured": section.outputs[0],
        "model": removal.run,
        "of_deviations": removal.shifted_run,
        "not_expanded": removal.deleted_run,
    }
    shown = {name: MICRO / 1e3 * values[part] for name, values in traces.items()}
    with draw((9.6, 5.0)) as figure:
        near, far = figure.subplots(2, 1, sharex=True)
        for axes in (near, far):
            axes.plot(timepts, shown["measured"], ".", color=MEASURED, markersize=4, label="measured")
            axes.plot(timepts, shown["model"], color=AFTER, linewidth=3.0, alpha=0.5, label="model")
            axes.plot(timepts, shown["of_deviations"], color=INK, linewidth=0.8, label="model of deviations, put back")
            axes.set_ylabel("displacement (mm)")
        far.plot(timepts, shown["not_expanded"], color=BEFORE, label="only a constant left out")
        far.set_xlabel("time (s)")
        legend_above(figure, far, 4)
        drawing = Drawing.of(
            figure,
            "removal",
            f"Removal of the DC component of {one.name} (thesis section 4.2, table 4.3)",
            "Free runs over the held-out section. Above: the model of deviations has other parameters and more terms, "
            "and runs as the model does. Below: the same terms without a constant, given deviations, are another system"
            + (", although this structure has no constant." if Term(()) not in removal.model.terms else "."),
        )
    return drawing, {"time_s": timepts, **{f"{name}_mm": values for name, values in shown.items()}}


def _first(each: Sequence[Analysed]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {"frequency_Hz": FREQUENCIES}
    with draw((9.6, 4.2)) as figure:
        gain, phase = figure.subplots(1, 2)
        for one, (colour, line) in zip(each, STYLES, strict=False):
            response, band = one.first, one.first.band()
            gain.fill_between(FREQUENCIES, MICRO * band.low, MICRO * band.high, color=colour, alpha=0.15, linewidth=0)
            gain.plot(FREQUENCIES, MICRO * response.gain, color=colour, linestyle=line, label=one.name)
            phase.plot(FREQUENCIES, response.phase_deg, color=colour, linestyle=line)
            key = one.name.replace(" ", "")
            columns |= {
                f"{key}_um_per_V": MICRO * response.gain,
                f"{key}_low": MICRO * band.low,
                f"{key}_high": MICRO * band.high,
                f"{key}_phase_deg": response.phase_deg,
            }
        for axes in (gain, phase):
            axes.axvspan(BAND[1], FREQUENCIES[-1], color=MEASURED, alpha=0.12, linewidth=0)
            axes.set(xscale="log", xlabel="frequency (Hz)", xlim=(FREQUENCIES[0], FREQUENCIES[-1]))
            _plain(axes)
        gain.set(ylabel="|H₁| (µm/V)", ylim=(0, None))
        phase.set_ylabel("phase (°)")
        legend_above(figure, gain, 6)
        drawing = Drawing.of(
            figure,
            "gfrf1",
            "First-order frequency responses of the six (thesis figure 4.10 A)",
            f"About {OPERATING_INPUT:g} V; the gain with 95 % bands that the parameters' covariance gives. Grey: "
            "beyond the noise that the models were identified with, where they extrapolate.",
        )
    return drawing, columns


def _second(each: Sequence[Analysed]) -> tuple[Drawing, Columns]:
    every = {one.name: 20 * np.log10(MICRO * one.second.gain) for one in each}
    columns = {"f1_Hz": each[0].second.frequency_Hz[:, 0], "f2_Hz": each[0].second.frequency_Hz[:, 1]}
    columns |= {f"{name.replace(' ', '')}_um_per_V2": 10 ** (values / 20) for name, values in every.items()}
    low, high = (f(f(values) for values in every.values()) for f in (min, max))
    levels = np.arange(np.floor(low), np.ceil(high) + 1)
    with draw((9.6, 5.8)) as figure:
        panels = figure.subplots(2, 3, sharex=True, sharey=True, squeeze=False)
        for axes, (name, values) in zip(panels.ravel(), every.items(), strict=False):
            drawn = map_of(axes, GRID, values, levels)
            axes.set_title(name, loc="left", fontsize="medium")
        for axes in panels.ravel()[len(every) :]:
            axes.set_axis_off()
        for axes in panels[-1]:
            axes.set_xlabel("f₁ (Hz)")
        for axes in panels[:, 0]:
            axes.set_ylabel("f₂ (Hz)")
        figure.colorbar(drawn, ax=panels, label="|H₂| (dB re 1 µm/V²)", shrink=0.8)  # type: ignore[arg-type]
        drawing = Drawing.of(
            figure,
            "gfrf2",
            "Second-order frequency responses of the six (thesis figure 4.10 B)",
            f"About {OPERATING_INPUT:g} V. The ridge runs where f₁ + f₂ = 0: there the second order makes what is slow "
            "or constant.",
        )
    return drawing, columns


def _test_signal(side: Side, name: str) -> tuple[Drawing, Columns]:
    """The record beside the test signal: both signals, their powers' spectra, and the NOFRF that each gives."""
    n, step = side.random.size, side.signal.sample_time
    timepts = np.asarray((np.arange(n) - n // 2) * step, dtype=np.float64)
    equal = np.roll(side.signal.values, n // 2)
    columns: dict[str, Array] = {"time_s": timepts, "random_V": side.random, "designed_V": equal}
    with draw((9.6, 6.2)) as figure:
        (left, *above), below = figure.subplots(2, 3)
        left.plot(timepts, side.random, color=AFTER, label="random record")
        left.plot(timepts, equal, color=INK, label="test signal")
        left.set(xlabel="time (s)", ylabel="deviation (V)")
        for axes, order in zip((*above, below[0]), (1, 2, 3), strict=True):
            for spectra, colour, marker in ((side.random_inputs, AFTER, "."), (side.designed_inputs, INK, "")):
                u = spectra[order - 1]
                inside = u.frequency_Hz <= order * BAND[1] + 1e-9
                axes.plot(u.frequency_Hz[inside], np.abs(u.values[inside]), color=colour, marker=marker, markersize=3)
                key = "random" if colour == AFTER else "designed"
                columns |= {f"line{order}_Hz": u.frequency_Hz, f"{key}_U{order}": np.abs(u.values)}
            axes.set(yscale="log", xlabel="frequency (Hz)", ylabel=f"|U{SUBSCRIPTS[order]}| ({_power('V', order)})")
        for axes, order in zip(below[1:], (2, 3), strict=True):
            for fit, colour, size in ((side.by_random, AFTER, 4), (side.designed, INK, 0)):
                g = fit.orders[order - 1]
                axes.plot(g.frequency_Hz, MICRO * g.gain, color=colour, marker=".", markersize=size, linewidth=0.9)
                key = "random" if colour == AFTER else "designed"
                columns |= {f"{key}_G{order}_Hz": g.frequency_Hz, f"{key}_G{order}": MICRO * g.gain}
            axes.set(
                yscale="log",
                xlabel="frequency (Hz)",
                ylabel=f"|G{SUBSCRIPTS[order]}| ({UNITS[order - 1]})",
                xlim=(-0.1, order * BAND[1] + 0.1),
            )
        legend_above(figure, left, 2)
        drawing = Drawing.of(
            figure,
            "test_signal",
            "The record is no test signal (thesis figure 4.11)",
            f"The band-limited pulse beside as long a piece of the record of {name}, and with equal rms in the spectra "
            "of their powers. Lines of the record meet with arbitrary phases: U₂ and U₃ have deep dips, and what "
            "divides by them, G₂ and G₃ of this actuator's model, jumps from line to line.",
        )
    return drawing, filled(columns)


def _nofrfs(each: Sequence[Analysed], amplitude: float) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 3.8)) as figure:
        panels = figure.subplots(1, ORDERS)
        for place, axes in enumerate(panels):
            n = place + 1
            for one, (colour, line) in zip(each, STYLES, strict=False):
                fitted, direct = one.fitted.orders[place], one.direct[place]
                axes.plot(fitted.frequency_Hz, MICRO * fitted.gain, color=colour, linestyle=line, label=one.name)
                axes.plot(direct.frequency_Hz, MICRO * direct.gain, ".", color=colour, markersize=2)
                key = f"{one.name.replace(' ', '')}_G{n}"
                columns |= {
                    f"G{n}_Hz": fitted.frequency_Hz,
                    f"{key}_least_squares": MICRO * fitted.gain,
                    f"{key}_direct": MICRO * direct.gain,
                }
            axes.set(xlabel="frequency (Hz)", ylabel=f"|G{SUBSCRIPTS[n]}| ({UNITS[place]})", ylim=(0, None))
        legend_above(figure, panels[0], 6)
        drawing = Drawing.of(
            figure,
            "nofrfs",
            "NOFRFs of the six (thesis figure 4.12)",
            f"About {OPERATING_INPUT:g} V, for the test signal of 0 to {BAND[1]:g} Hz. Lines: least squares over "
            f"levels up to {amplitude:.2g} V. Dots: from the models, without truncation.",
        )
    return drawing, filled(columns)


def _series(found: Actuators) -> tuple[Drawing, Columns]:
    """What is left of the free run by more and more orders, of two common structures."""
    orders = np.arange(1.0, MOST_ORDERS + 1)
    columns: dict[str, Array] = {"orders": orders}
    with draw((9.6, 3.6)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        every = {"linear in the output": [one.left for one in found.each], "with products": list(found.rival.left)}
        for axes, (label, left) in zip(panels, every.items(), strict=True):
            for one, values, (colour, line) in zip(found.each, left, STYLES, strict=False):
                shown = 100 * np.maximum(values, NOTHING)
                axes.plot(orders, shown, line, color=colour, marker="o", markersize=3, label=one.name)
                columns[f"{one.name.replace(' ', '')}_{label.replace(' ', '_')}_percent"] = 100 * values
            axes.set(yscale="log", xlabel="orders summed", xticks=orders)
            axes.set_title(label, loc="left", fontsize="medium")
        panels[0].set_ylabel("left of the free run (%)")
        legend_above(figure, panels[0], 6)
        drawing = Drawing.of(
            figure,
            "series",
            "How many orders there are",
            "Under a piece of the record at its own size, what the sum of the orders leaves of the settled free run. "
            "Left: the models of this page, whose series ends at their degree (what is below "
            f"{100 * NOTHING:.0e} % is rounding and drawn there). Right: the best common structure with products of "
            "past output and command, whose series has no end and diverges.",
        )
    return drawing, columns


def _sampled(one: Sampled) -> tuple[Drawing, Columns]:
    """Orders of the output with propagated bands, and those of drawn parameters."""
    columns: dict[str, Array] = {"frequency_Hz": one.orders[0].frequency_Hz}
    with draw((9.6, 3.6)) as figure:
        panels = figure.subplots(1, len(one.orders))
        for place, axes in enumerate(panels):
            n, response = place + 1, one.orders[place]
            f, band = response.frequency_Hz, response.band()
            there = response.gain > 1e-9 * response.gain.max()
            low, high = np.quantile(np.abs(one.draws[:, place]), (0.025, 0.975), axis=0)
            axes.fill_between(
                f[there],
                MICRO * band.low[there],
                MICRO * band.high[there],
                color=AFTER,
                alpha=0.35,
                linewidth=0,
                label="95 % band, propagated",
            )
            axes.plot(f[there], MICRO * response.gain[there], color=AFTER, label="posterior mean")
            axes.plot(f[there], MICRO * low[there], ":", color=INK, label="95 % of the draws")
            axes.plot(f[there], MICRO * high[there], ":", color=INK)
            axes.set_title(f"|Y{SUBSCRIPTS[n]}|", loc="left", fontsize="medium")
            axes.set(xlabel="frequency (Hz)", ylim=(0, None))
            columns |= {
                f"Y{n}_um": MICRO * response.gain,
                f"Y{n}_low": MICRO * band.low,
                f"Y{n}_high": MICRO * band.high,
                f"Y{n}_drawn_low": MICRO * low,
                f"Y{n}_drawn_high": MICRO * high,
            }
        panels[0].set_ylabel("Fourier coefficient (µm)")
        legend_above(figure, panels[0], 3)
        drawing = Drawing.of(
            figure,
            "sampled",
            f"Orders of the output of {one.name} with bands (in place of thesis figure 6.13)",
            f"The model that SVB finds among all candidates, {len(one.model.terms)} terms, under the test signal. "
            f"Bands: propagated from the posterior, and those of {len(one.draws)} draws of it.",
        )
    return drawing, columns


def _anchor(one: Anchor) -> tuple[Drawing, Columns]:
    f = one.frequency_Hz
    known = {
        f"bare film, {1e3 * SMALL:.0f} mV": (one.film, INK, "o-"),
        f"with hysteresis, {1e3 * SMALL:.0f} mV": (one.small, MEASURED, "s--"),
        f"with hysteresis, {1e3 * LARGE:.0f} mV": (one.large, MEASURED, "o-"),
    }
    models = {
        "model of the bare film, least squares": (one.least_squares, MARK),
        "model of the bare film, least free-run error": (one.refined, AFTER),
        "model of the actuator": (one.recorded, BEFORE),
    }
    columns: dict[str, Array] = {"frequency_Hz": f}
    with draw((9.6, 4.2)) as figure:
        axes = figure.add_subplot()
        for label, (values, colour, style) in known.items():
            gain, named = MICRO * np.abs(values), f"{label} (the actuator itself)"
            axes.plot(f, gain, style, color=colour, markersize=4, label=named)
            columns[label.replace(" ", "_").replace(",", "")] = gain
        for label, (response, colour) in models.items():
            band = response.band()
            axes.plot(f, MICRO * response.gain, color=colour, linewidth=1.6, label=label)
            if response is not one.refined:
                axes.fill_between(f, MICRO * band.low, MICRO * band.high, color=colour, alpha=0.15, linewidth=0)
            columns[label.replace(" ", "_").replace(",", "")] = MICRO * response.gain
        axes.set(xscale="log", xlabel="frequency (Hz)", ylabel="|H₁| (µm/V)")
        axes.set_ylim(0, 1.35 * MICRO * float(np.abs(one.film).max()))
        _plain(axes)
        legend_above(figure, axes, 2)
        drawing = Drawing.of(
            figure,
            "anchor",
            f"What {one.name} itself answers, and what models say of it",
            f"Tones about {OPERATING_INPUT:g} V in the simulated plant, without sensor noise. With hysteresis the gain "
            "depends on the size of the command, and no first-order response holds for all sizes.",
        )
    return drawing, columns


def _plain(axes: Axes) -> None:
    """0.01, 0.1 and 1 instead of powers."""
    from matplotlib.ticker import NullFormatter

    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _power(unit: str, order: int) -> str:
    return unit + ("", "", "²", "³")[order]
