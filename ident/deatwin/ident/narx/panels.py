"""Axes one below another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def panels_or_new(axes: Sequence[Axes] | None, count: int, *, height: float, sharex: bool = False) -> list[Axes]:
    """Return the user's axes, or new ones below each other; matplotlib is loaded only now."""
    if axes is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(6.4, 0.4 + height * max(count, 1)), layout="constrained")
        return list(figure.subplots(max(count, 1), 1, sharex=sharex, squeeze=False)[:, 0][:count])
    if len(axes) < count:
        raise ModelError(f"{count} panels need as many axes; got {len(axes)}")
    return list(axes)[:count]
