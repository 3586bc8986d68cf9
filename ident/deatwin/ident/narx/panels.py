"""Panels one below the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["panels_or_new"]


def panels_or_new(axes: Sequence[Axes] | None, count: int, *, height: float, sharex: bool = False) -> list[Axes]:
    """Axes to draw in; matplotlib is loaded only now.

    Parameters
    ----------
    axes : sequence of matplotlib Axes, or None
        The user's, if any.
    count : int
        How many are needed.
    height : float
        Height of a new panel in inches.
    sharex : bool
        Whether new panels share their horizontal axis.

    Returns
    -------
    list of matplotlib Axes, length ``count``

    Raises
    ------
    ModelError
        If the user gives too few.
    """
    if axes is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(6.4, 0.4 + height * max(count, 1)), layout="constrained")
        return list(figure.subplots(max(count, 1), 1, sharex=sharex, squeeze=False)[:, 0][:count])
    if len(axes) < count:
        raise ModelError(f"{count} panels need as many axes; got {len(axes)}")
    return list(axes)[:count]
