"""Helpers for results that draw themselves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis as Axis
    from matplotlib.figure import Figure as Figure
else:  # matplotlib is loaded only by what draws
    Axes = Axis = Figure = Any


def axes_or_new(ax: Axes | None) -> Axes:
    """Return the given axes, or new ones; matplotlib is loaded only if they are needed."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def panels_or_new(axes: Sequence[Axes] | None, count: int, *, height: float, sharex: bool = False) -> list[Axes]:
    """Return the user's axes, or new ones below each other; matplotlib is loaded only now."""
    if axes is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(6.4, 0.4 + height * max(count, 1)), layout="constrained")
        return list(figure.subplots(max(count, 1), 1, sharex=sharex, squeeze=False)[:, 0][:count])
    if len(axes) < count:
        raise ModelError(f"{count} panels need as many axes; got {len(axes)}")
    return list(axes)[:count]


def written_unit(unit: str) -> str:
    """Return a unit as axes show it, its powers raised. `unit` as "m/V^2"; returns As "m/V$^2$", for matplotlib."""
    return re.sub(r"\^(\d)\b", r"$^\1$", re.sub(r"\^(\d\d+)", r"$^{\1}$", unit))


def plain_numbers(axis: Axis, *steps: float) -> None:
    """Write 0.1, 1 and 10 instead of powers, at the given multiples of each power of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter

    if steps:
        axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def numbers_of_decades(axis: Axis, short: float = 100.0) -> None:
    """Write 0.1, 1 and 10; also 2 and 5 if the axis covers less than the factor `short`."""
    low, high = axis.get_view_interval()
    plain_numbers(axis, *((1.0, 2.0, 5.0) if high < short * low else (1.0,)))


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
