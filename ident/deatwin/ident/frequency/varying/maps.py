"""Responses along time as plain arrays, which can be sent to other processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.varying.response import VaryingResponse
from deatwin.plant.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Map:
    """A response over time and frequency."""

    timepts: Array  # shape (n_times,): s
    frequencies: Array  # shape (n,): Frequencies of the first tone, Hz
    values: NDArray[np.complex128]  # shape (n_times, n): in the response's unit
    equilibria: Array  # shape (n_times,): in the output's unit
    equilibrium_std: Array

    @classmethod
    def of(cls, response: VaryingResponse) -> Self:
        """Take the arrays from a response along time."""
        frequencies = response.frequency_Hz
        return cls(
            timepts=response.timepts,
            frequencies=frequencies if frequencies.ndim == 1 else frequencies[:, 0],
            values=response.values,
            equilibria=response.equilibria,
            equilibrium_std=response.equilibrium_std,
        )

    @property
    def gain(self) -> Array:
        """Magnitude, shape (n_times, n)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @property
    def change_dB(self) -> Array:
        """Gain divided by its mean over time at each frequency, dB, shape (n_times, n)."""
        return np.asarray(20 * np.log10(self.gain / self.gain.mean(axis=0)))
