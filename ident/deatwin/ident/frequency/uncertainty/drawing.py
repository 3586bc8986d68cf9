"""Drawings of uncertain frequency responses: ellipses in the complex plane, bands of gain and phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.response import Band
    from deatwin.ident.frequency.uncertainty.regions import Uncertain

__all__ = ["plot_draws", "plot_gain", "plot_phase", "plot_plane", "shown_points"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MOST_ELLIPSES = 24  # more of them cover each other
_MOST_POINTS = 300


def plot_plane(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw a response in the complex plane with its ellipses, dashed where the linear law does not hold.

    Parameters
    ----------
    uncertain : Propagated or Sampled
        What is drawn.
    ax : matplotlib Axes, optional
        Where to draw; new axes otherwise.

    Returns
    -------
    matplotlib Axes
    """
    from matplotlib.collections import LineCollection

    axes = axes_or_new(ax)
    color = f"C{len(axes.collections)}"
    if uncertain.label not in axes.get_legend_handles_labels()[1]:
        axes.plot(uncertain.values.real, uncertain.values.imag, color=color, linewidth=1.2, label=uncertain.label)
    shown = shown_points(uncertain.values.size)
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
    unit = f" ({uncertain.unit})" if uncertain.unit else ""
    axes.set_xlabel(f"real part{unit}")
    axes.set_ylabel(f"imaginary part{unit}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize="small")
    return axes


def shown_points(n: int) -> NDArray[np.int64]:
    """Return which of many frequencies get an ellipse: evenly some of them.

    Parameters
    ----------
    n : int
        How many there are.
    """
    return np.unique(np.linspace(0, n - 1, min(n, _MOST_ELLIPSES)).round().astype(np.int64))


def plot_draws(uncertain: Uncertain, draws: Complex, axes: Axes) -> None:
    """Draw some draws as points under the ellipses.

    Parameters
    ----------
    uncertain : Sampled
        Whose draws they are.
    draws : ndarray of complex, shape (n_draws, n)
        All of them.
    axes : matplotlib Axes
        Where to draw.
    """
    some = draws[:_MOST_POINTS, shown_points(uncertain.values.size)]
    axes.plot(some.real.ravel(), some.imag.ravel(), ".", color="0.6", markersize=1.5, alpha=0.4, zorder=1)


def plot_gain(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw the gain of a response with its band.

    Parameters
    ----------
    uncertain : Propagated or Sampled
        What is drawn.
    ax : matplotlib Axes, optional
        Where to draw; new axes otherwise.

    Returns
    -------
    matplotlib Axes
    """
    axes = axes_or_new(ax)
    _draw_band(axes, uncertain, uncertain.gain, uncertain.gain_band(), f"$|{uncertain.label.strip('$')}|$")
    axes.set_yscale("log")
    axes.set_ylabel(f"gain ({uncertain.unit})" if uncertain.unit else "gain")
    return axes


def plot_phase(uncertain: Uncertain, ax: Axes | None = None) -> Axes:
    """Draw the phase of a response with its band, which has gaps where the phase is undefined.

    Parameters
    ----------
    uncertain : Propagated or Sampled
        What is drawn.
    ax : matplotlib Axes, optional
        Where to draw; new axes otherwise.

    Returns
    -------
    matplotlib Axes
    """
    axes = axes_or_new(ax)
    _draw_band(axes, uncertain, uncertain.phase_deg, uncertain.phase_band(), f"phase of {uncertain.label}")
    axes.set_ylabel("phase (°)")
    return axes


def _draw_band(axes: Axes, uncertain: Uncertain, values: Array, band: Band, label: str) -> None:
    frequency, name = _axis(uncertain)
    color = f"C{len(axes.collections)}"
    if label not in axes.get_legend_handles_labels()[1]:
        axes.plot(frequency, values, color=color, label=label)
    text = f"{_percent(band.level)} band {uncertain.source}"
    axes.fill_between(frequency, band.low, band.high, color=color, alpha=0.25, linewidth=0, label=text)
    exact = ~band.linear_law
    if uncertain.linearised and exact.any():
        axes.plot(
            np.tile(np.where(exact, frequency, np.nan), 2), np.concatenate([band.low, band.high]), ".", color=color,
            markersize=3, label="by the exact law of the ellipse",
        )  # fmt: skip
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
    return np.asarray(uncertain.frequency_Hz.sum(axis=1)), "frequency of the output, sum of the tones' (Hz)"
