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
    """Return the coordinate along a line of frequencies, shape (n,), and descriptions of all frequencies."""
    moving = int(np.argmax(np.ptp(frequency, axis=0) > 0))
    along = frequency[:, moving]
    far = np.flatnonzero(along != along[0])
    if far.size == 0:
        raise ModelError("a map takes more than one point along a line of frequencies; draw `at` a time instead")
    slopes = np.round((frequency[far[-1]] - frequency[0]) / (along[far[-1]] - along[0]), 9)
    offsets = frequency[0] - slopes * along[0]
    if np.any(np.abs(frequency - np.outer(along, slopes) - offsets) > 1e-6 * np.abs(frequency).max()):
        raise ModelError(
            "these frequencies do not lie on a line; a map over time needs omega as np.stack([w, w], axis=-1) for "
            "f2 = f1, or np.stack([w, np.full_like(w, w0)], axis=-1) for f2 = w0 / 2 pi"
        )
    others = [f"$f_{i + 1} = {_written(slopes[i], offsets[i], moving)}$" for i in range(len(slopes)) if i != moving]
    return along, ", ".join([f"$f_{moving + 1}$ (Hz)", *others])


def _written(slope: float, offset: float, moving: int) -> str:
    """Write ``slope * f + offset`` as text."""
    if slope == 0:
        return rf"{offset:.4g}\,\mathrm{{Hz}}"
    factor = {1.0: "", -1.0: "-"}.get(slope, f"{slope:.4g}\\,")
    shift = "" if abs(offset) < 1e-9 else rf" {offset:+.4g}\,\mathrm{{Hz}}"
    return f"{factor}f_{moving + 1}{shift}"


def edges(centres: Array) -> Array:
    """Return cell borders halfway between centres, shape (n + 1,)."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
