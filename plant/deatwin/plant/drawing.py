"""Helpers of all results that draw themselves."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def axes_or_new(ax: Axes | None) -> Axes:
    """Axes to draw on; matplotlib is loaded only if new ones are needed."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def written_unit(unit: str) -> str:
    """Return a unit as axes show it, its powers raised. `unit` as "m/V^2"; returns As "m/V$^2$", for matplotlib."""
    return re.sub(r"\^(\d)\b", r"$^\1$", re.sub(r"\^(\d\d+)", r"$^{\1}$", unit))
