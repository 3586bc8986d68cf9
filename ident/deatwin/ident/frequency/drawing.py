"""Drawings of frequency responses: gain and phase over frequency. Those over several frequencies are in `maps`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.uncertainty.gain_phase import interval_radius
from deatwin.plant.drawing import axes_or_new, numbers_of_decades, plain_numbers, written_unit
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.response import FrequencyResponse


_ROUNDING = 1e-10  # gains below this share of the largest are rounding and are not drawn


def plot_response(response: FrequencyResponse, ax: Axes | None = None) -> Axes:
    """Draw the gain of a response over one frequency or two."""
    axes = axes_or_new(ax)
    if response.omega.ndim == 1:
        return _plot_gain(response, axes)
    from deatwin.ident.frequency.maps import plot_map

    return plot_map(response, axes)


def bode(response: FrequencyResponse, axes: Sequence[Axes] | None = None) -> tuple[Axes, Axes]:
    """Plot gain and phase over frequency, each with its 95 % band.

    Parameters
    ----------
    response : FrequencyResponse
        Response with one frequency for each value.
    axes : sequence of two matplotlib Axes, optional
        Axes for gain and phase; new ones by default.

    Returns
    -------
    tuple of two matplotlib Axes

    Raises
    ------
    ModelError
        If the response has several frequencies for each value, or there are not two axes.
    """
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
    phase.set_xlabel("frequency (Hz)")
    phase.set_ylabel("phase (°)")
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
    axes.set_xscale("log" if np.all(frequencies > 0) else "linear")
    axes.set_yscale("log")
    say_zero(drawn, axes)
    if response.theta_cov.any():
        _shade(response, drawn, axes, line.get_color())
    numbers_of_decades(axes.yaxis)
    if axes.get_xscale() == "log":
        plain_numbers(axes.xaxis)
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel(f"gain ({written_unit(response.unit)})" if response.unit else "gain")
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
