"""What all results that draw themselves share."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["axes_or_new", "written_unit"]


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

    return pyplot.subplots(layout="constrained")[1]


def written_unit(unit: str) -> str:
    """Return a unit as axes show it, its powers raised.

    Parameters
    ----------
    unit : str
        As "m/V^2".

    Returns
    -------
    str
        As "m/V$^2$", for matplotlib.
    """
    return re.sub(r"\^(\d)\b", r"$^\1$", re.sub(r"\^(\d\d+)", r"$^{\1}$", unit))
