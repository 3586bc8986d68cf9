"""What all results that draw themselves share."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["axes_or_new"]


def axes_or_new(ax: Axes | None) -> Axes:
    """Axes to draw in; matplotlib is loaded only now.

    Parameters
    ----------
    ax : matplotlib Axes or None
        The user's, if any.

    Returns
    -------
    matplotlib Axes
    """
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots()[1]
