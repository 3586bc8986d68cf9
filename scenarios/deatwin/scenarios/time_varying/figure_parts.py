"""What the figures of the story share: maps over time and frequency, and their data as columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.studies.report.svg import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "AFTER",
    "BEFORE",
    "INK",
    "MARK",
    "MEASURED",
    "Columns",
    "draw_band",
    "draw_map",
    "filled",
    "ink_on",
    "map_columns",
    "share_bar",
]

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))


def draw_map(axes: Axes, timepts: Array, frequencies: Array, values: Array, **how: Any) -> Any:
    """Draw values over time and frequency.

    Parameters
    ----------
    axes : matplotlib Axes
        Where.
    timepts : ndarray, shape (n_times,)
        s.
    frequencies : ndarray, shape (n,)
        Hz.
    values : ndarray, shape (n_times, n)
        What.
    **how
        As `matplotlib.axes.Axes.pcolormesh` takes it: ``norm``, or ``vmin`` and ``vmax``, and ``cmap``.

    Returns
    -------
    matplotlib QuadMesh
    """
    axes.grid(False)
    return axes.pcolormesh(timepts, frequencies, values.T, shading="nearest", rasterized=True, **how)


def ink_on(mesh: Any, value: float) -> str:
    """Colour of words on a cell of a map: the one of black and white that stands out more.

    Parameters
    ----------
    mesh : matplotlib QuadMesh
        The map.
    value : float
        Of the cell.

    Returns
    -------
    str
        A shade beside the grey one: greys follow the page into the dark, and the map does not.
    """
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in mesh.to_rgba(value)[:3]]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]  # WCAG 2
    return "#000001" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fffffe"


def share_bar(figure: Figure, mesh: Any, panels: Sequence[Axes], label: str) -> None:
    """Put one colour bar beside several panels.

    Parameters
    ----------
    figure : matplotlib Figure
        Theirs.
    mesh : matplotlib QuadMesh
        With the colours.
    panels : sequence of matplotlib Axes
        Beside which it stands.
    label : str
        What the colours mean.
    """
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.01, aspect=12 * len(panels))
    bar.set_label(label, fontsize="small")
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def draw_band(axes: Axes, timepts: Array, middle: Array, half: Array, colour: str, label: str) -> None:
    """Draw a line with its 95 % band.

    Parameters
    ----------
    axes : matplotlib Axes
        Where.
    timepts, middle, half : ndarray, shape (n,)
        Times, values, and half the width of the band.
    colour, label : str
        Of the line.
    """
    axes.fill_between(timepts, middle - half, middle + half, color=colour, alpha=0.25, linewidth=0)
    axes.plot(timepts, middle, color=colour, linewidth=1.2, label=label)


def map_columns(prefix: str, timepts: Array, frequencies: Array, **values: Array) -> dict[str, Array]:
    """Columns of maps on one grid, time by time.

    Parameters
    ----------
    prefix : str
        Of the names.
    timepts : ndarray, shape (n_times,)
        s.
    frequencies : ndarray, shape (n,)
        Hz.
    **values : ndarray, shape (n_times, n)
        By name.

    Returns
    -------
    dict of str to ndarray, shape (n_times n,)
    """
    columns = {
        f"{prefix}_time_s": np.repeat(timepts, frequencies.size),
        f"{prefix}_frequency_Hz": np.tile(frequencies, timepts.size),
    }
    return columns | {f"{prefix}_{name}": each.ravel() for name, each in values.items()}


def filled(columns: Columns) -> dict[str, Array]:
    """Columns of one length: the shorter ones end in gaps.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Of any length.

    Returns
    -------
    dict of str to ndarray
    """
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}
