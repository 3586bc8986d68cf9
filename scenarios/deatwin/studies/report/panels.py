"""What figures of several panels share: colours by role, titles, axes without powers, and columns of one length."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.studies.report.svg import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
STYLES = tuple((colour, line) for line in ("-", "--") for colour in (AFTER, BEFORE, MARK))
"""Colour and line of each of six curves."""
SUBSCRIPTS = "₀₁₂₃₄₅₆₇₈"


def panels_of(figure: Figure, rows: int, columns: int, x: str = "", y: str = "", **how: Any) -> NDArray[np.object_]:
    """Panels of a figure, shape (rows, columns): `x` below the last row, `y` beside all of them."""
    panels: NDArray[np.object_] = figure.subplots(rows, columns, squeeze=False, **how)
    for axes in panels[-1]:
        axes.set_xlabel(x)
    if y:
        figure.supylabel(y, fontsize="medium")
    return panels


def titled(axes: Axes, text: str, size: str = "medium") -> None:
    """Write a title at the left."""
    axes.set_title(text, loc="left", fontsize=size)


def draw_between(
    axes: Axes, x: Array, low: Array, high: Array, colour: str, label: str = "", alpha: float = 0.25
) -> None:
    """Draw a band. Shapes: `x, low, high` (n,)."""
    axes.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0, label=label or None)


def plain_numbers(axis: Axis, *steps: float) -> None:
    """Write 0.1, 1 and 10 instead of powers, at the given multiples of each power of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter

    if steps:
        axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def key_of(name: str) -> str:
    """The name of an actuator as it begins the names of columns and files."""
    return name.replace(" ", "")


def filled(columns: Columns) -> Columns:
    """Columns of one length: the shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}


def complete(columns: Columns) -> Columns:
    """The rows without a gap."""
    kept = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    return {name: column[kept] for name, column in columns.items()}
