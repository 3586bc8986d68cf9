"""Drawings of frequency responses along time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.colors import Normalize


Array = NDArray[np.float64]

_NARROW = 10.0  # largest ratio of gains for which colours are linear in the gain
_RANGE = 1e4  # largest ratio of gains on the colour scale; smaller gains share one colour


def colours(gain: Array) -> tuple[float, Normalize]:
    """Return the gain below which all values share one colour, and the colour scale."""
    from matplotlib.colors import LogNorm, Normalize

    largest = float(np.nanmax(gain, initial=0.0)) or 1.0
    least = float(np.nanmin(gain, initial=largest))
    if largest <= _NARROW * least:
        return least, Normalize(least, largest)
    positive = float(np.nanmin(np.where(gain > 0, gain, np.nan), initial=largest))
    low = max(positive, largest / _RANGE)
    return low, LogNorm(low, largest)


def first_tone(frequency: Array) -> tuple[Array, str]:
    """Return the first tone that is not constant, shape (n,), and its label. Shapes: `frequency` (n, order)."""
    moving = int(np.argmax(np.ptp(frequency, axis=0) > 0))
    if np.unique(frequency[:, moving]).size < len(frequency):
        raise ModelError("a map over time shows one line of frequencies: give each point its own first frequency")
    return frequency[:, moving], f"$f_{moving + 1}$ (Hz)"


def edges(centres: Array) -> Array:
    """Return cell borders halfway between centres, shape (n + 1,)."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
