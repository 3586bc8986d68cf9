"""The drawing of a comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.frequency.comparison.compare import Comparison


def plot_comparison(comparison: Comparison, ax: Axes | None = None) -> Axes:
    """Draw a table of differences: a row for each pair, a column for each order and band."""
    from deatwin.ident.frequency.comparison.compare import Agreement

    pairs, columns = comparison.pairs, comparison.columns
    shape = len(pairs), len(columns)
    rows = [f"{first} – {second}" for first, second in pairs]
    axes = _new_axes(shape, max(map(len, rows))) if ax is None else ax
    sizes = np.array([100 * d.size if d.differs else np.nan for d in comparison.differences]).reshape(shape)
    most = max(float(np.nanmax(sizes, initial=0.0)), 1.0)
    image = axes.imshow(sizes, cmap="YlOrBr", vmin=0.0, vmax=most, aspect="auto")
    for number, difference in enumerate(comparison.differences):
        if difference.differs:
            percent = 100 * difference.size
            text = f"{percent:.0f}" if percent >= 10 else f"{percent:.1f}"
            row, column = divmod(number, shape[1])
            axes.text(
                column,
                row,
                f"({text})" if difference.agreement is Agreement.DRIFT else text,
                ha="center",
                va="center",
                fontsize="x-small",
                color="white" if percent > 0.6 * most else "black",
            )
    axes.set_yticks(range(shape[0]), rows, fontsize="small")
    names = [f"$H_{order}$\n{low:g}–{high:g}" for order, low, high in columns]
    axes.set_xticks(range(shape[1]), names, fontsize="small")
    axes.set_xlabel("order and band of output frequencies (Hz)")
    for edge in np.flatnonzero(np.diff([order for order, _, _ in columns])):
        axes.axvline(edge + 0.5, color="0.4", linewidth=0.8)
    axes.figure.colorbar(image, ax=axes, label="difference (% of gain); in brackets: may be drift")
    return axes


def _new_axes(shape: tuple[int, int], longest: int) -> Axes:
    """Axes of a figure in which rows, columns, and names of so many letters have room."""
    from matplotlib import pyplot

    size = max(6.4, 1.6 + 0.6 * shape[1] + 0.075 * longest), max(4.0, 1.2 + 0.25 * shape[0])  # inches
    axes: Axes = pyplot.subplots(figsize=size, layout="constrained")[1]
    return axes
