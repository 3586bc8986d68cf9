"""The describing function of a quantiser, of any number of steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MANY_STEPS = 1e4  # from here on two terms of the asymptotic series are exact to rounding
_HUGE = 1e100  # ratio of amplitude to step from which a larger one makes no difference


def quantiser_gain(ratio: Array) -> Array:
    """N of rounding to the nearest multiple of a step."""
    held = np.minimum(ratio, _HUGE)
    gain = np.array(_many_steps(np.maximum(held, _MANY_STEPS)))
    for place in np.argwhere(held < _MANY_STEPS):
        gain[tuple(place)] = _few_steps(float(held[tuple(place)]))
    return gain


def _few_steps(ratio: float) -> float:
    """N of a quantiser at a ratio of amplitude to step: each edge, at (k + 1/2) steps, is a relay of one step."""
    edges = np.arange(np.floor(ratio + 0.5)) + 0.5
    if not edges.size:
        return 0.0
    return float(4.0 / (np.pi * ratio) * np.sum(np.sqrt(np.maximum(1.0 - (edges / ratio) ** 2, 0.0))))


def _many_steps(ratio: Array) -> Array:
    r"""Gain for many steps: a midpoint sum, whose only error comes from the root at the sine's peak.

    .. math:: N = 1 + \frac{4 \sqrt 2}{\pi} (r^{-3/2} \zeta(-1/2, a) - r^{-5/2} \zeta(-3/2, a)/4 - ...)
    """
    # The truncation error is below 1e-3 r^(-7/2): 1e-17 from 1e4 steps on.
    last = ratio + 0.5 - np.floor(ratio + 0.5)
    off = ratio**-1.5 * _hurwitz(-0.5, last) - 0.25 * ratio**-2.5 * _hurwitz(-1.5, last)
    return np.asarray(1.0 + 4.0 * np.sqrt(2.0) / np.pi * off)


def _hurwitz(s: float, a: Array) -> Array:
    """Hurwitz's zeta function, s above -2 and a from 0 to 1, by Euler and Maclaurin's formula from 16 terms on."""
    end = a + 16.0
    head = np.sum((a[..., None] + np.arange(16)) ** -s, axis=-1)
    tail = end ** (1.0 - s) / (s - 1.0) + 0.5 * end**-s + s / 12.0 * end ** (-s - 1.0)
    return np.asarray(head + tail - s * (s + 1.0) * (s + 2.0) / 720.0 * end ** (-s - 3.0))
