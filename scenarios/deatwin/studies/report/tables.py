"""Tables as text: CSV for files, parameters of models, and the data of a drawn figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.drawing import Axes, Figure

if TYPE_CHECKING:
    from deatwin.ident.narx import NarxModel


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the text of a CSV file; cells may contain commas, and None gives an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def parameters_by_term(*models: NarxModel) -> list[list[str]]:
    """Return rows of a table: each term of any model, by degree, with its parameter in each model."""
    values = [dict(zip(model.terms, model.theta, strict=True)) for model in models]
    every = sorted({term for each in values for term in each}, key=lambda term: (term.degree, term.factors))
    return [[str(term), *(f"{each[term]:.4g}" if term in each else "–" for each in values)] for term in every]


HEADER = ("panel", "title", "horizontal", "vertical", "series", "kind", "x", "y", "value")
_SAME = 1e-9  # largest distance of a position from the tick that names it

Rows = Iterator[tuple[str, str, Any]]


def drawn_table(figure: Figure) -> str:
    """Return the points of everything drawn in a figure."""
    figure.draw_without_rendering()  # gives the ticks their texts
    panels = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    return csv_text(HEADER, (row for number, axes in enumerate(panels, start=1) for row in _rows(number, axes)))


def _rows(number: int, axes: Axes) -> Iterator[tuple[object, ...]]:
    """Return the points of a panel."""
    across, up = _names(axes.xaxis), _names(axes.yaxis)
    for series, kind, points in _series(axes):
        shown = "" if series.startswith("_child") else series.removeprefix("_")  # which hides it from a legend
        told = (number, axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel(), shown, kind)
        for x, y, *value in np.asarray(points, dtype=float).reshape(-1, 3 if kind == "map" else 2).tolist():
            yield *told, _cell(x, across), _cell(y, up), "".join(f"{v:.9g}" for v in value)


def _series(axes: Axes) -> Rows:
    """Return label, kind and points of each artist drawn in data coordinates; for a map, also its values."""
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
    from matplotlib.container import BarContainer

    for line in axes.lines:
        if line.get_transform() == axes.transData:
            yield str(line.get_label()), "line", line.get_xydata()
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            for bar in bars.patches:
                yield str(bars.get_label()), "bar", _tip(bar, bars.orientation == "horizontal")
    for collection in axes.collections:
        label = str(collection.get_label())
        if isinstance(collection, LineCollection):
            for stroke in collection.get_segments():
                yield label, "stroke", stroke
        elif isinstance(collection, QuadMesh):
            yield label, "map", _cells_of(collection)
        elif isinstance(collection, PathCollection):
            yield label, "point", collection.get_offsets()
        elif isinstance(collection, PolyCollection):
            for path in collection.get_paths():
                yield label, "band", path.vertices


def _cells_of(mesh: Any) -> Any:
    """Return middle and value of each cell, shape (n, 3)."""
    corners = mesh.get_coordinates()
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    return np.dstack([middles, np.ma.filled(mesh.get_array(), np.nan).reshape(middles.shape[:2])])


def _tip(bar: Any, lying: bool) -> tuple[float, float]:
    x, y, width, height = bar.get_x(), bar.get_y(), bar.get_width(), bar.get_height()
    return (x + width, y + height / 2) if lying else (x + width / 2, y + height)


def _names(axis: Any) -> dict[float, str]:
    """Return the positions on an axis that have names instead of numbers."""
    from matplotlib.category import StrCategoryFormatter
    from matplotlib.ticker import FixedFormatter

    if not isinstance(axis.get_major_formatter(), FixedFormatter | StrCategoryFormatter):
        return {}
    return {
        float(place): tick.get_text() for place, tick in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
    }


def _cell(value: float, names: dict[float, str]) -> str:
    near = next((name for place, name in names.items() if abs(place - value) < _SAME), None)
    return near or f"{value:.9g}"
