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


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))


def draw_map(axes: Axes, timepts: Array, frequencies: Array, values: Array, **how: Any) -> Any:
    """Draw values over time and frequency. Shapes: `timepts` (n_times,); `frequencies` (n,); `values` (n_times, n)."""
    axes.grid(False)
    return axes.pcolormesh(timepts, frequencies, values.T, shading="nearest", rasterized=True, **how)


def ink_on(mesh: Any, value: float) -> str:
    """Colour of words on a cell of a map: the one of black and white that stands out more."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in mesh.to_rgba(value)[:3]]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]  # WCAG 2
    return "#000001" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fffffe"


def share_bar(figure: Figure, mesh: Any, panels: Sequence[Axes], label: str) -> None:
    """Put one colour bar beside several panels."""
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.01, aspect=12 * len(panels))
    bar.set_label(label, fontsize="small")
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def draw_band(axes: Axes, timepts: Array, middle: Array, half: Array, colour: str, label: str) -> None:
    """Draw a line with its 95 % band. Shapes: `timepts, middle, half` (n,)."""
    axes.fill_between(timepts, middle - half, middle + half, color=colour, alpha=0.25, linewidth=0)
    axes.plot(timepts, middle, color=colour, linewidth=1.2, label=label)


def map_columns(prefix: str, timepts: Array, frequencies: Array, **values: Array) -> dict[str, Array]:
    """Columns of maps on one grid, time by time. Shapes: `timepts` (n_times,); `frequencies` (n,); `**values`
    (n_times, n); returns (n_times n,).
    """
    columns = {
        f"{prefix}_time_s": np.repeat(timepts, frequencies.size),
        f"{prefix}_frequency_Hz": np.tile(frequencies, timepts.size),
    }
    return columns | {f"{prefix}_{name}": each.ravel() for name, each in values.items()}


def filled(columns: Columns) -> dict[str, Array]:
    """Columns of one length: the shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}
