"""Helpers for results that draw themselves."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


def axes_or_new(ax: Axes | None) -> Axes:
    """Return the given axes, or new ones; matplotlib is loaded only if they are needed."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def written_unit(unit: str) -> str:
    """Return a unit as axes show it, its powers raised. `unit` as "m/V^2"; returns As "m/V$^2$", for matplotlib."""
    return re.sub(r"\^(\d)\b", r"$^\1$", re.sub(r"\^(\d\d+)", r"$^{\1}$", unit))


def envelope(timepts: Array, values: Array, columns: int = 500) -> tuple[Array, Array]:
    """Return the lowest and the highest sample in each column of a picture. Shapes: `timepts, values` (n,)."""
    n = values.size
    if n <= 2 * columns:
        return timepts, values
    size = -(-n // columns)
    padded = np.concatenate([values, np.full(-n % size, values[-1])]).reshape(-1, size)
    first = size * np.arange(padded.shape[0])
    kept = np.unique(np.minimum(np.concatenate([first + padded.argmin(axis=1), first + padded.argmax(axis=1)]), n - 1))
    return timepts[kept], values[kept]
