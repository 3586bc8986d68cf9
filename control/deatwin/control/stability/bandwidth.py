"""Bandwidth of closed loops from the frequency responses of their open loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import Array


def bandwidth_Hz(omega: Array, loops: NDArray[np.complex128]) -> Array:
    """Return the frequency at which abs(L/(1 + L)) first falls below -3 dB, else the last, (n,) Hz; `loops` (n, k)."""
    closed = np.abs(loops / (1.0 + loops))
    below = closed < np.sqrt(0.5)
    first = np.where(below.any(axis=1), below.argmax(axis=1), omega.size - 1)
    found = np.empty(len(loops))
    for n, k in enumerate(first):
        if k == 0:
            found[n] = omega[0]
            continue
        pair = np.log(closed[n, k - 1 : k + 1])
        share = np.clip((np.log(np.sqrt(0.5)) - pair[0]) / (pair[1] - pair[0]), 0.0, 1.0)
        found[n] = np.exp(np.log(omega[k - 1]) + share * np.log(omega[k] / omega[k - 1]))
    return np.asarray(found / (2 * np.pi))
