"""Figures of the benchmark systems, after figures 7.1 to 7.5 of the thesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.uncertainty.beside_draws import Spread
from deatwin.scenarios.frequency_uncertainty.benchmarks import Benchmarks, Sweep
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, DRAWN, OTHER, LAW, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
CLOUD = 400
"""Draws that are shown as points."""


def benchmark_drawings(found: Benchmarks) -> list[tuple[Drawing, Columns]]:
    """Draw what was done with the benchmark systems."""
    return [
        _complex(found.linear),
        _plane(found.linear),
        _gain_and_phase(found.linear, found.notch),
        _higher(found),
        _spectra(found.spectra),
        _law(found.sweeps),
    ]


def _complex(spread: Spread) -> tuple[Drawing, Columns]:
    """A real and a complex quantity, and what is known of them."""
    response, place = spread.propagated, int(np.argmax(_relative(spread)))
    draws, edge = spread.sampled.draws[:, place], response.ellipse()[place]
    covariance, gain = response.covariance[place], float(response.gain[place])
    deviation = float(np.sqrt(response.gain_phase_covariance[place, 0, 0]))
    band = response.gain_band()
    reach = np.sqrt(np.trace(covariance) / 2) * np.abs(edge - response.values[place]).max()
    radius = reach / np.sqrt(np.linalg.eigvalsh(covariance)[-1])
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        left.hist(np.abs(draws), bins=60, density=True, color=DRAWN, alpha=0.5)
        axis = gain + deviation * np.linspace(-4, 4, 121)
        density = np.exp(-0.5 * ((axis - gain) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
        left.plot(axis, density, color=LAW)
        left.axvspan(band.low[place], band.high[place], color=LAW, alpha=0.12, linewidth=0)
        left.set_axisbelow(True)
        left.set(xlabel=f"gain |H₁| at {response.frequency_Hz[place]:.3f} Hz", ylabel="density")
        left.set_title("a real quantity: an interval", loc="left", fontsize="medium")
        right.plot(draws[:CLOUD].real, draws[:CLOUD].imag, ".", color=DRAWN, markersize=3, label="draws")
        right.plot(edge.real, edge.imag, color=LAW, label="95 % region, propagated")
        circle = response.values[place] + radius * np.exp(2j * np.pi * np.linspace(0, 1, edge.size))
        right.plot(circle.real, circle.imag, "--", color=INK, linewidth=0.9, label="as if both parts were alike")
        right.set(xlabel="real part", ylabel="imaginary part", adjustable="datalim", aspect="equal")
        right.set_title("a complex one: an ellipse", loc="left", fontsize="medium")
        legend_above(figure, right, 3)
        drawing = Drawing.of(
            figure,
            "complex",
            "What is known of a real and of a complex quantity (thesis figure 7.1)",
            f"{spread.case}: {spread.symbol} at the frequency at which it is known worst. Left: histogram of "
            f"{len(spread.sampled.draws):,} draws, the propagated density and its 95 % interval. Right: real and "
            "imaginary part vary together, and not by as much; a circle of the same mean variance says too much one "
            "way and too little the other.",
        )
    return drawing, {
        "ellipse_real": edge.real,
        "ellipse_imaginary": edge.imag,
        "circle_real": circle.real,
        "circle_imaginary": circle.imag,
    }


def _plane(spread: Spread) -> tuple[Drawing, Columns]:
    """The first-order response in the complex plane, whole and near the resonance."""
    values, curve = spread.propagated.values, spread.curve
    worst = int(np.argmax(_relative(spread)))
    near = range(max(0, worst - 2), min(worst + 3, values.size))
    with draw((9.6, 4.6)) as figure:
        left, right = figure.subplots(1, 2)
        for axes, shown, cloud in ((left, range(0, values.size), 0), (right, near, CLOUD)):
            axes.plot(curve.real, curve.imag, color=INK, linewidth=0.7)
            _regions(axes, spread, shown, cloud)
            axes.set(xlabel="real part", ylabel="imaginary part")
        left.set_title("all frequencies", loc="left", fontsize="medium")
        right.set_title("about the frequency that is known worst", loc="left", fontsize="medium")
        points = spread.sampled.draws[:CLOUD, near.start : near.stop]
        right.set(xlim=_padded(points.real), ylim=_padded(points.imag))
        legend_above(figure, right, 3)
        drawing = Drawing.of(
            figure,
            "plane",
            "H₁ of a linear system in the complex plane (thesis figure 7.2)",
            f"{spread.case}. Ellipses: 95 % regions from the covariance of the parameters. Points: {CLOUD} of "
            f"{len(spread.sampled.draws):,} draws.",
        )
    return drawing, _columns([spread])


def _gain_and_phase(linear: Spread, notch: Spread) -> tuple[Drawing, Columns]:
    """Bands of gain and phase, where the linear law holds and where the gain is near zero."""
    with draw((9.6, 6.0)) as figure:
        panels = figure.subplots(2, 2, sharex="col")
        for column, spread in zip(panels.T, (linear, notch), strict=True):
            response, sampled = spread.propagated, spread.sampled
            bands = (response.gain_band(), response.phase_band())
            drawn = (sampled.gain_band(), sampled.phase_band())
            values_of = (response.gain, response.phase_deg)
            for axes, values, band, other in zip(column, values_of, bands, drawn, strict=True):
                frequency = response.frequency_Hz
                axes.fill_between(frequency, band.low, band.high, color=LAW, alpha=0.25, linewidth=0)
                axes.plot(frequency, values, color=LAW, label="identified, 95 % band propagated")
                axes.plot(frequency, other.low, ".", color=INK, markersize=3.5, label="95 % of the draws")
                axes.plot(frequency, other.high, ".", color=INK, markersize=3.5)
                _shade(axes, frequency, ~band.linear_law)
            column[0].set_title(spread.case, loc="left", fontsize="medium")
            column[1].set_xlabel("frequency (Hz)")
        panels[0, 0].set_ylabel("gain")
        for axes in panels[0]:
            axes.set_ylim(0, None)
        panels[1, 0].set_ylabel("phase (°)")
        legend_above(figure, panels[1, 1], 3)
        drawing = Drawing.of(
            figure,
            "gain_phase",
            "Gain and phase with their bands (thesis figure 7.3)",
            "Left: the law of propagation gives what the draws give. Right: a system whose gain vanishes at one "
            "frequency. There the gain of a normal complex number is not normal and its phase may be anything: where "
            "the linear law of gain or phase fails (ochre), the band is the range of the ellipse, and there is none of "
            "the phase where the ellipse holds zero.",
        )
    return drawing, _columns([linear, notch])


def _higher(found: Benchmarks) -> tuple[Drawing, Columns]:
    """Regions of H_2 and H_3, and H_2 over two frequencies with its relative uncertainty."""
    second, third = found.bilinear[1:]
    surface = found.surface
    side = round(surface.values.size**0.5)
    axis = surface.frequency_Hz[:side, 1]
    longest = np.sqrt(np.linalg.eigvalsh(surface.covariance)[:, -1])
    with draw((9.6, 8.2)) as figure:
        above, below = figure.subplots(2, 2)
        for axes, spread in zip(above, (second, third), strict=True):
            axes.plot(spread.curve.real, spread.curve.imag, color=INK, linewidth=0.7)
            _regions(axes, spread, range(spread.propagated.values.size), CLOUD // 4)
            axes.set(xlabel="real part", ylabel="imaginary part")
            axes.set_title(f"{spread.symbol} at equal frequencies", loc="left", fontsize="medium")
        maps = (
            (np.log10(surface.gain), "gain of H₂ (log₁₀)"),
            (100 * longest / surface.gain, "standard deviation of H₂ (% of its gain)"),
        )
        for axes, (values, title) in zip(below, maps, strict=True):
            drawn = axes.contourf(axis, axis, values.reshape(side, side), levels=12, cmap="cividis")
            figure.colorbar(drawn, ax=axes)
            axes.set(xlabel="first frequency (Hz)", ylabel="second frequency (Hz)", aspect="equal")
            axes.set_title(title, loc="left", fontsize="medium")
            axes.grid(False)
        legend_above(figure, above[0], 3)
        drawing = Drawing.of(
            figure,
            "higher_orders",
            "Regions of H₂ and H₃ (thesis figure 7.4)",
            f"{second.case}. Above: at equal frequencies. Below: H₂ over both frequencies; the "
            "deviation is that along the longer axis of the ellipse.",
        )
    return drawing, _columns([second, third])


def _spectra(spectra: Sequence[Spread]) -> tuple[Drawing, Columns]:
    """The orders of the output of a multisine, with bands."""
    with draw((9.6, 5.6)) as figure:
        panels = figure.subplots(2, len(spectra), sharex="col", sharey="row", height_ratios=(1, 1))
        for (above, below), spread in zip(panels.T, spectra, strict=True):
            frequency, gain = spread.propagated.frequency_Hz, spread.propagated.gain
            band, drawn = spread.propagated.gain_band(), spread.sampled.gain_band()
            above.plot(frequency, gain, "o", color=LAW, markersize=3)
            above.vlines(frequency, 1e-9, gain, color=LAW, linewidth=0.8)
            above.set(yscale="log", ylim=(1e-7, 1e-1))
            above.set_title(spread.symbol, loc="left", fontsize="medium")
            low, high, below_it, above_it = (
                100 * (limit / gain - 1) for limit in (band.low, band.high, drawn.low, drawn.high)
            )
            below.vlines(frequency, low, high, color=LAW, alpha=0.4, linewidth=5, label="95 % band, propagated")
            below.plot(frequency, below_it, "_", color=INK, markersize=6, label="95 % of the draws")
            below.plot(frequency, above_it, "_", color=INK, markersize=6)
            below.set_xlabel("frequency (Hz)")
        panels[0, 0].set_ylabel("amplitude")
        panels[1, 0].set_ylabel("band, about the amplitude (%)")
        legend_above(figure, panels[1, 0], 2)
        drawing = Drawing.of(
            figure,
            "spectra",
            "Orders of the output spectrum with their bands (thesis figure 7.5)",
            f"{spectra[0].case}, in the steady state of a random-phase multisine. Lines at which an order has no power "
            "are left out, as are those at zero and at half the sampling rate, whose values are real.",
        )
    return drawing, _columns(spectra)


def _law(sweeps: Sequence[Sweep]) -> tuple[Drawing, Columns]:
    """How far the law of propagation is off, over how uncertain the parameters are."""
    columns: dict[str, Array] = {}
    with draw((9.6, 4.0)) as figure:
        left, right = figure.subplots(1, 2)
        for sweep, colour in zip(sweeps, (LAW, OTHER, MARK), strict=True):
            for axes, values in ((left, 100 * sweep.held), (right, np.sqrt(sweep.ratios))):
                axes.plot(sweep.indices, values, "-", color=colour, linewidth=1.0, label=sweep.label)
                axes.plot(sweep.indices[sweep.holds], values[sweep.holds], "o", color=colour, markersize=5)
                axes.plot(sweep.indices[~sweep.holds], values[~sweep.holds], "x", color=colour, markersize=7)
            key = sweep.label.replace(" ", "_")
            columns |= {
                f"{key}_scale": sweep.scales,
                f"{key}_nonlinearity": sweep.indices,
                f"{key}_held": sweep.held,
                f"{key}_variance_ratio": sweep.ratios,
            }
        for axes in (left, right):
            axes.set(xscale="log", xlabel="nonlinearity")
        left.axhline(95, color=INK, linewidth=0.7, linestyle=":")
        left.set(ylabel="draws in the 95 % region (%)")
        right.axhline(1, color=INK, linewidth=0.7, linestyle=":")
        right.set(ylabel="deviation of the draws over that propagated", yscale="log")
        legend_above(figure, left, len(sweeps))
        drawing = Drawing.of(
            figure,
            "law",
            "Where the linear law fails",
            "The same systems with all deviations of their parameters halved, and up to 32 times as large; at the "
            "frequency, and right in the direction too, at which draws and propagation are furthest apart. Dots: "
            "propagation says that its law holds; crosses: it warns. Far beyond the warning the draws have no finite "
            "variance, as some of their poles come as near to the unit circle as one likes.",
        )
    return drawing, columns


def _regions(axes: Axes, spread: Spread, shown: Sequence[int], cloud: int) -> None:
    from matplotlib.collections import LineCollection

    places = list(shown)
    edges, values = spread.propagated.ellipse()[places], spread.propagated.values[places]
    draws = spread.sampled.draws[:cloud, places].ravel()
    if cloud:
        axes.plot(draws.real, draws.imag, ".", color=DRAWN, markersize=2.5, label="draws")
    outlines = np.stack([edges.real, edges.imag], axis=-1)
    axes.add_collection(LineCollection(list(outlines), colors=LAW, label="95 % region, propagated"))
    axes.plot(values.real, values.imag, ".", color=INK, markersize=3, label="identified")
    axes.autoscale_view()


def _relative(spread: Spread) -> Array:
    longest: Array = np.sqrt(np.linalg.eigvalsh(spread.propagated.covariance)[:, -1])
    return longest / spread.propagated.gain


def _shade(axes: Axes, frequency: Array, flags: NDArray[np.bool_]) -> None:
    half, label = (frequency[1] - frequency[0]) / 2, "linear law fails"
    for place in np.flatnonzero(flags):
        axes.axvspan(frequency[place] - half, frequency[place] + half, color=MARK, alpha=0.2, linewidth=0, label=label)
        label = "_"


def _padded(values: Array) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


def _columns(spreads: Sequence[Spread]) -> dict[str, Array]:
    """Values, propagated covariances, and those of the draws; one response after the other."""
    every: dict[str, list[Array]] = {}
    for number, spread in enumerate(spreads, start=1):
        response = spread.propagated
        tones = response.frequency_Hz.reshape(response.values.size, -1)
        of: dict[str, Array] = {
            "response": np.full(len(tones), float(number)),
            "order": np.full(len(tones), float(response.response.order)),
            "output_frequency_Hz": tones.sum(axis=1),
            "real": response.values.real,
            "imaginary": response.values.imag,
            "nonlinearity": response.nonlinearity,
        }
        for name, (i, j) in {"real_real": (0, 0), "real_imaginary": (0, 1), "imaginary_imaginary": (1, 1)}.items():
            of[f"propagated_{name}"] = response.covariance[:, i, j]
            of[f"drawn_{name}"] = spread.sampled.covariance[:, i, j]
        for name, values in of.items():
            every.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in every.items()}
