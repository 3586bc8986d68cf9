"""Drawings of uncertain frequency responses: ellipses in the complex plane, bands of gain and phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.drawing import drawn_points
from deatwin.plant.drawing import axes_or_new, written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.response import Band
    from deatwin.ident.frequency.uncertainty.regions import Uncertain


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MOST_ELLIPSES = 24  # more of them cover each other
_MOST_POINTS = 300


def plot_plane(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw a response in the complex plane with its ellipses, dashed where the linear law does not hold."""
    from matplotlib.collections import LineCollection

    axes = axes_or_new(ax)
    color = f"C{len(axes.collections)}"
    if uncertain.label not in axes.get_legend_handles_labels()[1]:
        some = uncertain.values[drawn_points(uncertain.response)]
        axes.plot(
            some.real, some.imag, color=color, linewidth=1.2, markersize=4, label=uncertain.label, **_style(uncertain)
        )
    shown = shown_points(uncertain)
    outlines = uncertain.ellipse()[shown]
    segments = np.stack([outlines.real, outlines.imag], axis=-1)
    holds = uncertain.linear_law[shown]
    name = f"{_percent(uncertain.level)} ellipses {uncertain.source}"
    for chosen, style, text in ((holds, "-", name), (~holds, "--", f"{name}, where the linear law fails")):
        if chosen.any():
            lines = LineCollection(
                list(segments[chosen]), colors=color, linewidths=0.9, linestyles=style, alpha=0.8, label=text
            )
            axes.add_collection(lines)
    axes.autoscale_view()
    unit = f" ({written_unit(uncertain.unit)})" if uncertain.unit else ""
    axes.set_xlabel(f"real part{unit}")
    axes.set_ylabel(f"imaginary part{unit}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize="small")
    return axes


def shown_points(uncertain: Uncertain) -> NDArray[np.int64]:
    """Return which of many frequencies get an ellipse: evenly some of those where the gain is more than rounding."""
    there = np.flatnonzero(drawn_points(uncertain.response))
    return there[np.unique(np.linspace(0, there.size - 1, min(there.size, _MOST_ELLIPSES)).round().astype(np.int64))]


def plot_draws(uncertain: Uncertain, draws: Complex, axes: Axes) -> None:
    """Draw some draws as points under the ellipses. Shapes: `draws` (n_draws, n)."""
    some = draws[:_MOST_POINTS, shown_points(uncertain)]
    axes.plot(some.real.ravel(), some.imag.ravel(), ".", color="0.6", markersize=1.5, alpha=0.4, zorder=1)


def plot_gain(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw the gain of a response with its band."""
    axes = axes_or_new(ax)
    _draw_band(axes, uncertain, uncertain.gain, uncertain.gain_band(), f"$|{uncertain.label.strip('$')}|$")
    axes.set_yscale("log")
    axes.set_ylabel(f"gain ({written_unit(uncertain.unit)})" if uncertain.unit else "gain")
    return axes


def plot_phase(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw the phase of a response with its band, which has gaps where the phase is undefined."""
    axes = axes_or_new(ax)
    _draw_band(axes, uncertain, uncertain.phase_deg, uncertain.phase_band(), f"phase of {uncertain.label}")
    axes.set_ylabel("phase (°)")
    return axes


def _draw_band(axes: Axes, uncertain: Uncertain, values: Array, band: Band, label: str) -> None:
    frequency, name = _axis(uncertain)
    color = f"C{len(axes.collections)}"
    drawn = drawn_points(uncertain.response)
    if label not in axes.get_legend_handles_labels()[1]:
        axes.plot(frequency, np.where(drawn, values, np.nan), color=color, label=label, **_style(uncertain))
    text = f"{_percent(band.level)} band {uncertain.source}"
    if _is_line(uncertain):
        axes.fill_between(frequency, band.low, band.high, where=drawn, color=color, alpha=0.25, linewidth=0, label=text)
    else:
        axes.vlines(frequency[drawn], band.low[drawn], band.high[drawn], color=color, alpha=0.5, label=text)
    exact = drawn & ~band.linear_law
    if uncertain.linearised and exact.any():
        axes.plot(
            np.tile(np.where(exact, frequency, np.nan), 2),
            np.concatenate([band.low, band.high]),
            ".",
            color=color,
            markersize=3,
            label="range of the ellipse",
        )
    if np.all(frequency > 0):
        axes.set_xscale("log")
    axes.set_xlabel(name)
    axes.legend(fontsize="small")


def _percent(level: float) -> str:
    return f"{100 * level:g} %"


def _axis(uncertain: Uncertain) -> tuple[Array, str]:
    """Frequency of the output in Hz: the sum of those of the tones."""
    if uncertain.omega.ndim == 1:
        return uncertain.frequency_Hz, "frequency (Hz)"
    if not _goes_one_way(_sums(uncertain)):
        raise ModelError(
            f"the points of {uncertain.label} are no line, the sums of their frequencies going up and down; draw gain "
            "and doubt as a map, `response.plot()` (plot_map), or take points along a line with `at_points`"
        )
    return _sums(uncertain), "frequency of the output, sum of the tones' (Hz)"


def _is_line(uncertain: Uncertain) -> bool:
    """True if neighbouring points form a curve: lines of a spectrum and points of a grid do not."""
    if uncertain.response.symbol == "Y":
        return False
    return uncertain.omega.ndim == 1 or _goes_one_way(_sums(uncertain))


def _style(uncertain: Uncertain) -> dict[str, Any]:
    return {} if _is_line(uncertain) else {"linestyle": "none", "marker": "."}


def _sums(uncertain: Uncertain) -> Array:
    return np.asarray(uncertain.frequency_Hz.sum(axis=1))


def _goes_one_way(frequency: Array) -> bool:
    steps = np.diff(frequency)
    return bool(np.all(steps > 0) or np.all(steps < 0))
