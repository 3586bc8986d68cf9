"""Detection on paper: spectrum, cumulated periodogram and correlations, each beside what chance allows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from deatwin.plant.amplitudes import amount, written_amplitude

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.mismatch.detect.detection import Detection


def draw(detection: Detection, ax: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Draw a detection.

    Parameters
    ----------
    detection : Detection
        What is drawn.
    ax : sequence of three matplotlib Axes, optional
        Where to draw; a new figure otherwise.

    Returns
    -------
    sequence of three matplotlib Axes
    """
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots(1, 3, figsize=(13, 3.8), layout="constrained")[1]
    _spectrum(detection, ax[0])
    _cumulated(detection, ax[1])
    _correlations(detection, ax[2])
    return ax


def _spectrum(detection: Detection, axes: Axes) -> None:
    curves, (unit, size) = detection.curves, written_amplitude(detection.output_unit)
    axes.loglog(curves.frequency, curves.spectrum / size**2, color="C0", linewidth=1.2, label="residual")
    axes.axhline(curves.noise / size**2, color="0.4", linestyle="--", linewidth=1, label="sensor noise")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel(f"power density, {f'{unit}²' if unit else 1}/Hz")
    axes.set_title(
        f"excess {amount(f'{detection.size / size:.3g}', unit)}, counts from "
        f"{amount(f'{detection.practical / size:.3g}', unit)}",
        fontsize="small",
        loc="left",
    )
    axes.legend(fontsize="small")


def _cumulated(detection: Detection, axes: Axes) -> None:
    curves = detection.curves
    low, high = (np.clip(curves.expected + s * curves.distance, 0.0, 1.0) for s in (-1, 1))
    axes.fill_between(curves.lines, low, high, color="0.88", label="99 % of chance")
    axes.plot(curves.lines, curves.expected, color="0.5", linewidth=0.8)
    axes.plot(curves.lines, curves.cumulated, color="C0", linewidth=1.2, label="residual")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("cumulated periodogram")
    axes.set_title(f"p = {detection.p_value:.2g}, all statistics together", fontsize="small", loc="left")
    axes.legend(fontsize="small", loc="lower right")


def _correlations(detection: Detection, axes: Axes) -> None:
    curves = detection.curves
    groups = [name.split(" ")[0] if " ago" not in name else name.rsplit(" ", 3)[0] for name in curves.regressors]
    places = np.arange(len(groups))
    outside = np.abs(curves.correlations) > curves.bound
    axes.axhspan(-curves.bound, curves.bound, color="0.88", zorder=0, label="99 % of chance")
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    for chosen, colour in ((~outside, "C0"), (outside, "C3")):
        axes.vlines(places[chosen], 0.0, curves.correlations[chosen], color=colour, linewidth=1.5)
    edges = [0, *(k for k in places[1:] if groups[k] != groups[k - 1]), len(groups)]
    middles = [(a + b - 1) / 2 for a, b in pairwise(edges)]
    written = [groups[k].replace("time", "t").replace("^2", "²").replace("^3", "³") for k in edges[:-1]]
    axes.set_xticks(middles, written)
    axes.tick_params(axis="x", length=0)
    for k in edges[1:-1]:
        axes.axvline(k - 0.5, color="0.8", linewidth=0.6)
    reach = 1.15 * max(1.3 * curves.bound, float(np.abs(curves.correlations).max()))
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("regressor; its lags from left to right")
    axes.set_ylabel("correlation, standard deviations")
    axes.legend(fontsize="small", loc="upper right")
