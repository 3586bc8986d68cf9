"""Drawings of frequency responses: gain and phase over frequency, and contours over two frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.uncertainty.gain_phase import interval_radius
from deatwin.plant.arguments import instance
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Axes, axes_or_new, numbers_of_decades, plain_numbers, written_unit
from deatwin.plant.errors import ModelError

_ROUNDING = 1e-10  # gains below this share of the largest are rounding and are not drawn


_FEWEST_ON_A_LINE = 3  # least number of frequencies on each axis of a grid


def plot_response(response: FrequencyResponse, ax: Axes | None = None) -> Axes:
    """Draw the gain of a response over one frequency or two."""
    draw = _plot_gain if response.omega.ndim == 1 else plot_map
    return draw(response, axes_or_new(ax))


def bode(response: FrequencyResponse, axes: Sequence[Axes] | None = None) -> tuple[Axes, Axes]:
    """Plot gain and phase over frequency, each with its 95 % band.

    Parameters
    ----------
    response : FrequencyResponse
        Response as a function of one frequency: a linear frequency response H_1, a nonlinear output frequency response
        G_n or an output spectrum Y_n (see `FrequencyResponse`).
    axes : sequence of two matplotlib Axes, optional
        Axes for gain and phase; new ones by default.

    Returns
    -------
    tuple of two matplotlib Axes
        Axes for gain and phase.

    Raises
    ------
    ModelError
        If the response is a function of several frequencies, or `axes` does not have exactly two entries.
    """
    instance(FrequencyResponse)(response, "response")
    if response.omega.ndim != 1:
        raise ModelError(f"a Bode diagram has one frequency for each value; {response.label} has {response.order}")
    if axes is None:
        from matplotlib import pyplot

        axes = list(pyplot.subplots(2, 1, sharex=True, layout="constrained")[1])
    if len(axes) != 2:
        raise ModelError(f"a Bode diagram needs two axes, for gain and phase; got {len(axes)}")
    gain, phase = axes
    _plot_gain(response, gain)
    gain.set_xlabel("")
    degrees = np.where(drawn_points(response), response.phase_deg, np.nan)
    (line,) = phase.plot(response.frequency_Hz, degrees, **_style(response))
    if response.theta_cov.any():
        half = np.minimum(interval_radius(0.95, response.theta_dof) * response.phase_deviation_deg, 180.0)
        doubtful = ~response.band().linear_law
        limits = response.frequency_Hz, degrees - half, degrees + half
        phase.fill_between(*limits, color=line.get_color(), alpha=0.25, linewidth=0)
        phase.fill_between(*limits, where=doubtful, **_hatched(line.get_color()))
    phase.set_xscale(gain.get_xscale())
    if phase.get_xscale() == "log":
        plain_numbers(phase.xaxis)
    phase.set(xlabel="frequency (Hz)", ylabel="phase (°)")
    return gain, phase


def drawn_points(response: FrequencyResponse) -> NDArray[np.bool_]:
    """Return at which points the gain exceeds rounding errors, bool of shape (n,)."""
    gain = np.where(np.isfinite(response.gain), response.gain, 0.0)
    return np.asarray(gain > _ROUNDING * gain.max(initial=0.0), dtype=bool)


def say_zero(drawn: NDArray[np.bool_], axes: Axes) -> None:
    """Write into the axes that the response is zero, if it is."""
    if not drawn.any():
        axes.text(0.5, 0.5, "zero everywhere", transform=axes.transAxes, ha="center", va="center")


def _plot_gain(response: FrequencyResponse, axes: Axes) -> Axes:
    frequencies, drawn = response.frequency_Hz, drawn_points(response)
    name = response.label.strip("$")
    (line,) = axes.plot(frequencies, np.where(drawn, response.gain, np.nan), label=f"$|{name}|$", **_style(response))
    axes.set(xscale="log" if np.all(frequencies > 0) else "linear", yscale="log")
    say_zero(drawn, axes)
    if response.theta_cov.any():
        _shade(response, drawn, axes, line.get_color())
    numbers_of_decades(axes.yaxis)
    if axes.get_xscale() == "log":
        plain_numbers(axes.xaxis)
    axes.set(xlabel="frequency (Hz)", ylabel=f"gain ({written_unit(response.unit)})" if response.unit else "gain")
    axes.legend()
    return axes


def _shade(response: FrequencyResponse, drawn: NDArray[np.bool_], axes: Axes, colour: Any) -> None:
    """Draw the band of the gain, hatched where it cannot be trusted."""
    band = response.band()
    bottom = 0.3 * response.gain[drawn].min(initial=np.inf)  # a logarithmic axis has no zero
    low, doubtful = np.maximum(band.low, bottom), drawn & ~band.linear_law
    if response.symbol == "Y":
        where = response.frequency_Hz[drawn]
        axes.vlines(where, low[drawn], band.high[drawn], color=colour, alpha=0.5, label="95 % band")
        return
    axes.fill_between(
        response.frequency_Hz, low, band.high, where=drawn, color=colour, alpha=0.25, linewidth=0, label="95 % band"
    )
    if doubtful.any():
        axes.fill_between(
            response.frequency_Hz, low, band.high, where=doubtful, label="linear law fails", **_hatched(colour)
        )


def _hatched(colour: Any) -> dict[str, Any]:
    return {"facecolor": "none", "edgecolor": colour, "hatch": "///", "linewidth": 0}


def _style(response: FrequencyResponse) -> dict[str, Any]:
    """Return the line style: points for lines of a spectrum, and also for isolated points of a ratio of spectra."""
    return {"Y": {"linestyle": "none", "marker": "."}, "G": {"marker": "."}}.get(response.symbol, {})


def plot_map(response: FrequencyResponse, axes: Axes) -> Axes:
    """Draw the gain over the first two frequencies: contours on a grid, else points coloured by gain."""
    plane = _middle_slice(response)
    grid = _grid(plane)
    if grid is None:
        return _plot_points(response, axes)
    _label_map(axes.figure.colorbar(_contours(plane, grid, axes), ax=axes), plane, axes)
    return axes


class _Grid(NamedTuple):
    """All pairs of two lists of frequencies in Hz, and the position of each pair among the points."""

    first: Array
    second: Array
    position: NDArray[np.intp]

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        return values[self.position]


def _grid(response: FrequencyResponse) -> _Grid | None:
    """Return the grid that the first two frequencies form; None if they form none."""
    if not _is_slice(response):
        return None
    first, row = np.unique(response.frequency_Hz[:, 0], return_inverse=True)
    second, column = np.unique(response.frequency_Hz[:, 1], return_inverse=True)
    if min(first.size, second.size) < _FEWEST_ON_A_LINE or first.size * second.size != len(row):
        return None
    position = np.full((first.size, second.size), -1, dtype=np.intp)
    position[row, column] = np.arange(len(row))
    return _Grid(first, second, position) if np.all(position >= 0) else None


def _is_slice(response: FrequencyResponse) -> bool:
    """Return whether all frequencies after the second are constant."""
    return response.omega.ndim == 2 and bool(np.all(response.omega[:, 2:] == response.omega[:1, 2:]))


def _middle_slice(response: FrequencyResponse) -> FrequencyResponse:
    """Return the points at which the frequencies after the second are the middle ones of those given."""
    if response.omega.ndim == 1 or response.omega.shape[1] == 2:
        return response
    held = np.unique(response.omega[:, 2:], axis=0)
    return response.at_points(np.all(response.omega[:, 2:] == held[len(held) // 2], axis=1))


def _decibels(response: FrequencyResponse) -> Array:
    """Return the gain in dB relative to 1 unit; NaN where there is no value."""
    decibels = np.full(response.gain.shape, np.nan)
    np.log10(response.gain, out=decibels, where=drawn_points(response))
    return np.round(20 * decibels, 9)  # rounded, so that a constant gain has no contours


def _levels(decibels: Array) -> Array:
    """Return round contour levels that cover all values."""
    from matplotlib.ticker import MaxNLocator

    known = decibels[np.isfinite(decibels)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
    margin = max(0.0, 0.5 - (high - low))  # a constant response also needs a range of colours
    return np.asarray(MaxNLocator(18).tick_values(low - margin, high + margin), dtype=np.float64)


def _contours(response: FrequencyResponse, grid: _Grid, axes: Axes) -> Any:
    decibels = _decibels(response)
    drawn = axes.contourf(grid.first, grid.second, grid.of(decibels).T, levels=_levels(decibels), cmap="viridis")
    axes.contour(drawn, colors="white", linewidths=0.3, linestyles="solid")
    say_zero(drawn_points(response), axes)
    if response.theta_cov.any():
        doubtful = ~response.band().linear_law
        if doubtful.any():
            _hatch(grid.of(doubtful), grid, axes)
    return drawn


def _hatch(doubtful: NDArray[np.bool_], grid: _Grid, axes: Axes) -> None:
    from matplotlib.patches import Patch

    hatched = axes.contourf(
        grid.first, grid.second, doubtful.T.astype(float), levels=[0.5, 1.5], colors="none", hatches=["//"]
    )
    hatched.set_edgecolor("white")
    hatched.set_linewidth(0.0)
    proxy = Patch(facecolor="0.5", edgecolor="white", hatch="//", label="linear law fails")
    axes.legend(handles=[proxy], loc="upper right", frameon=True, facecolor="0.9", labelcolor="black")


def _plot_points(response: FrequencyResponse, axes: Axes) -> Axes:
    first, second = response.frequency_Hz[:, :2].T
    drawn = axes.scatter(first, second, c=_decibels(response), cmap="viridis", s=14)
    _label_map(axes.figure.colorbar(drawn, ax=axes), response, axes)
    return axes


def _label_map(bar: Any, response: FrequencyResponse, axes: Axes) -> None:
    unit = written_unit(response.unit)
    bar.set_label(f"|{response.label}| (dB re 1 {unit})" if unit else f"|{response.label}| (dB)")
    axes.set(xlabel="$f_1$ (Hz)", ylabel="$f_2$ (Hz)")
    others = response.frequency_Hz[:, 2:]
    if _is_slice(response) and others.size:
        axes.set_title(", ".join(f"$f_{i}$ = {held:.3g} Hz" for i, held in enumerate(others[0], start=3)))
