"""Drawings of frequency responses along time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.uncertainty.gain_phase import interval_radius
from deatwin.ident.frequency.varying.response import VaryingResponse, VaryingStatus
from deatwin.plant.drawing import axes_or_new, written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize


Array = NDArray[np.float64]

_DECADES = 20.0  # from the lowest to the highest frequency: the axis is logarithmic
_NARROW = 10.0  # gains within this have linear colours
_RANGE = 1e4  # gains below the largest by more than this have one colour


def plot_map(response: VaryingResponse, ax: Axes | None = None) -> Axes:
    """Draw the gain as a map over time and frequency."""
    axes = axes_or_new(ax)
    edges, gain, label = _along_line(response)
    low, norm = _colours(gain)
    mesh = axes.pcolormesh(_edges(response.timepts), edges, np.maximum(gain, low).T, norm=norm, rasterized=True)
    gaps = np.isnan(gain).all(axis=0)
    if edges[0] > 0 and edges[-1] > _DECADES * edges[0] and not gaps.any():
        axes.set_yscale("log")
    spans = _unstable(response)
    for first, last in spans:
        span = axes.axvspan(first, last, facecolor="none", edgecolor="white", hatch="//", linewidth=0)
        span.set_label("unstable" if (first, last) == spans[0] else "")
    if spans:
        axes.legend(loc="upper left", frameon=True, facecolor="0.6", labelcolor="black")
    name = response.label.strip("$")
    bar = axes.figure.colorbar(mesh, ax=axes, extend="min" if np.nanmin(gain) < low else "neither")
    bar.set_label(f"$|{name}|$ ({written_unit(response.unit)})" if response.unit else f"$|{name}|$")
    axes.set_xlabel("time (s)")
    axes.set_ylabel(label)
    return axes


def plot_equilibria(response: VaryingResponse, ax: Axes | None = None) -> Axes:
    """Draw the equilibrium over time with its 95 % band."""
    axes = axes_or_new(ax)
    dof = [np.inf if model is None else model.theta_dof for model in response.models]
    half = response.equilibrium_std * [interval_radius(0.95, each) for each in dof]
    low, high = response.equilibria - half, response.equilibria + half
    (line,) = axes.plot(response.timepts, response.equilibria, label="equilibrium")
    axes.fill_between(response.timepts, low, high, color=line.get_color(), alpha=0.25, linewidth=0, label="95 % band")
    axes.set_xlabel("time (s)")
    unit = next(model.output_units[0] for model in response.models if model is not None)
    axes.set_ylabel(f"equilibrium ({unit})" if unit else "equilibrium")
    axes.legend()
    return axes


def _colours(gain: Array) -> tuple[float, Normalize]:
    """Return the gain below which all have one colour, and the scale of the colours."""
    from matplotlib.colors import LogNorm, Normalize

    largest = float(np.nanmax(gain, initial=0.0)) or 1.0
    least = float(np.nanmin(gain, initial=largest))
    if largest <= _NARROW * least:
        return least, Normalize(least, largest)
    positive = float(np.nanmin(np.where(gain > 0, gain, np.nan), initial=largest))
    low = max(positive, largest / _RANGE)
    return low, LogNorm(low, largest)


def _along_line(response: VaryingResponse) -> tuple[Array, Array, str]:
    """Return borders of increasing frequencies in Hz, the gain between, and what the axis is called."""
    frequency, gain = response.frequency_Hz, response.gain
    label = "frequency (Hz)"
    if frequency.ndim == 2:
        frequency, label = _first_tone(frequency)
    order = np.argsort(frequency, kind="stable")
    frequency, gain = frequency[order], gain[:, order]
    if response.symbol != "G" or frequency.size == 1:
        return _edges(frequency), gain, label
    half = np.diff(frequency).min() / 2
    gaps = np.flatnonzero(np.diff(frequency) > 2.001 * half)
    edges = np.concatenate([frequency[:1] - half, frequency + half])
    edges = np.insert(edges, gaps + 2, frequency[gaps + 1] - half)
    return edges, np.insert(gain, gaps + 1, np.nan, axis=1), label


def _first_tone(frequency: Array) -> tuple[Array, str]:
    """Return the coordinate along a line of frequencies, shape (n,), and what it and the others are."""
    moving = int(np.argmax(np.ptp(frequency, axis=0) > 0))
    along = frequency[:, moving]
    far = np.flatnonzero(along != along[0])
    if far.size == 0:
        raise ModelError("a map takes more than one point along a line of frequencies; draw `at` a time instead")
    slopes = np.round((frequency[far[-1]] - frequency[0]) / (along[far[-1]] - along[0]), 9)
    offsets = frequency[0] - slopes * along[0]
    if np.any(np.abs(frequency - np.outer(along, slopes) - offsets) > 1e-6 * np.abs(frequency).max()):
        raise ModelError(
            "these frequencies do not lie on a line; a map over time needs omega as np.stack([w, w], axis=-1) for "
            "f2 = f1, or np.stack([w, np.full_like(w, w0)], axis=-1) for f2 = w0 / 2 pi"
        )
    others = [f"$f_{i + 1} = {_written(slopes[i], offsets[i], moving)}$" for i in range(len(slopes)) if i != moving]
    return along, ", ".join([f"$f_{moving + 1}$ (Hz)", *others])


def _written(slope: float, offset: float, moving: int) -> str:
    """Write slope * f + offset."""
    if slope == 0:
        return rf"{offset:.4g}\,\mathrm{{Hz}}"
    factor = {1.0: "", -1.0: "-"}.get(slope, f"{slope:.4g}\\,")
    shift = "" if abs(offset) < 1e-9 else rf" {offset:+.4g}\,\mathrm{{Hz}}"
    return f"{factor}f_{moving + 1}{shift}"


def _edges(centres: Array) -> Array:
    """Return the borders halfway between centres, shape (n + 1,)."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _unstable(response: VaryingResponse) -> list[tuple[float, float]]:
    """Return the spans of time in s in which the equilibrium is unstable."""
    edges = _edges(response.timepts)
    marked = np.array([status is VaryingStatus.UNSTABLE for status in response.statuses], dtype=int)
    change = np.diff(np.concatenate([[0], marked, [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return [(float(edges[i]), float(edges[j])) for i, j in zip(starts, ends, strict=True)]
