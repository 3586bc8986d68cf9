"""Responses along time as plain arrays, which travel between processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.varying.response import VaryingResponse

__all__ = ["Map", "root_mean_square"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Map:
    """A response over time and frequency.

    Parameters
    ----------
    timepts : ndarray, shape (n_times,)
        s.
    frequencies : ndarray, shape (n,)
        Of the first tone, Hz.
    values : ndarray of complex, shape (n_times, n)
        In ``unit``.
    unit : str
        Of the values.
    equilibria, equilibrium_std : ndarray, shape (n_times,)
        Equilibrium of each time and its standard deviation, in the output's unit.
    """

    timepts: Array
    frequencies: Array
    values: NDArray[np.complex128]
    unit: str
    equilibria: Array
    equilibrium_std: Array

    @classmethod
    def of(cls, response: VaryingResponse) -> Self:
        """Return what is drawn of a response along time.

        Parameters
        ----------
        response : VaryingResponse
            Along a line of frequencies.
        """
        frequencies = response.frequency_Hz
        return cls(
            timepts=response.timepts,
            frequencies=frequencies if frequencies.ndim == 1 else frequencies[:, 0],
            values=response.values,
            unit=response.unit,
            equilibria=response.equilibria,
            equilibrium_std=response.equilibrium_std,
        )

    @property
    def gain(self) -> Array:
        """Magnitude, shape (n_times, n)."""
        return np.asarray(np.abs(self.values), dtype=np.float64)

    @property
    def change_dB(self) -> Array:
        """Gain over its mean along time at each frequency, shape (n_times, n)."""
        return np.asarray(20 * np.log10(self.gain / self.gain.mean(axis=0)))


def root_mean_square(values: NDArray[np.complex128] | Array) -> float:
    """Of the magnitudes of all values.

    Parameters
    ----------
    values : ndarray
        Real or complex.
    """
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))
