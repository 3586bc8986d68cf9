"""Helpers for figures of several panels: colours by role, titles, axes without powers, equally long columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


class Hue:
    """Colours by role."""

    INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[r][0] for r in ("ink", "measured", "before", "after", "mark"))


STYLES = tuple((colour, line) for line in ("-", "--") for colour in (Hue.AFTER, Hue.BEFORE, Hue.MARK))
"""Colour and line style of each of six curves."""
SUBSCRIPTS = "₀₁₂₃₄₅₆₇₈"


def panels_of(figure: Figure, rows: int, columns: int, x: str = "", y: str = "", **how: Any) -> NDArray[np.object_]:
    """Make the panels of a figure, shape (rows, columns): `x` labels the last row, `y` all panels."""
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


def draw_map(axes: Axes, x: Array, y: Array, values: Array, **how: Any) -> Any:
    """Draw values over two axes as coloured cells. Shapes: `x` (n,); `y` (m,); `values` (n, m)."""
    axes.grid(False)
    return axes.pcolormesh(x, y, values.T, shading="nearest", rasterized=True, **how)


def share_bar(figure: Figure, mesh: Any, panels: Sequence[Axes], label: str) -> None:
    """Put one colour bar beside several panels."""
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.01, aspect=12 * len(panels))
    bar.set_label(label, fontsize="small")
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def ink_on(mesh: Any, value: float) -> str:
    """Return black or white, whichever is more visible on a cell of a map."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in mesh.to_rgba(value)[:3]]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]  # as defined by WCAG 2
    return "#000001" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fffffe"


def plain_numbers(axis: Axis, *steps: float) -> None:
    """Write 0.1, 1 and 10 instead of powers, at the given multiples of each power of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter

    if steps:
        axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def numbers_of_decades(axis: Axis, short: float) -> None:
    """Write 0.1, 1 and 10; also 2 and 5 if the axis covers less than the factor `short`."""
    low, high = axis.get_view_interval()
    plain_numbers(axis, *((1.0, 2.0, 5.0) if high / low < short else (1.0,)))


def key_of(name: str) -> str:
    """Return an actuator's name as a prefix for names of columns and files."""
    return name.replace(" ", "")


def filled(columns: Columns) -> Columns:
    """Extend columns to one length; shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}
