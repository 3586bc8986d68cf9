"""Drawings of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.response import FrequencyResponse

__all__ = ["plot_response"]


def plot_response(response: FrequencyResponse, ax: Axes | None = None) -> Axes:
    """Draw the gain of a response over frequency with its 95 % band.

    Parameters
    ----------
    response : FrequencyResponse
        What is drawn.
    ax : matplotlib Axes, optional
        Where to draw; new axes otherwise.

    Returns
    -------
    matplotlib Axes
    """
    axes = axes_or_new(ax)
    band = response.band()
    name = response.label.strip("$")
    (line,) = axes.plot(response.frequency_Hz, response.gain, label=f"$|{name}|$")
    axes.fill_between(
        response.frequency_Hz, band.low, band.high, color=line.get_color(), alpha=0.25, linewidth=0, label="95 % band"
    )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel(f"gain ({response.unit})" if response.unit else "gain")
    axes.legend()
    return axes
