r"""Columns of what is known of a plant's own error and of the laws of its effects, scaled by prior deviations.

B β: bends of the instantaneous relation (polynomials of degree 2 to 7 of the simulated reading), timing (its
derivative), known directions, and slow modes. L λ: what an effect contributes, times slow polynomials.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.legendre import legval, legvander

DEGREES = (2, 7)
"""Of bends: what is constant or linear the parameters take up; a bend of higher degree is no static relation of a film."""
GRID = 200
"""Points on which slow modes are found: the slowest few are smooth over so many."""


def bends(simulated: np.ndarray, rms: float) -> np.ndarray:
    """Polynomials of a reading (n,), orthonormal on the samples, (n, 6): `rms` is that of all of them together, SI."""
    first, last = DEGREES
    basis = np.linalg.qr(legvander(_unit(simulated), last))[0][:, first:]
    return basis * rms * np.sqrt(simulated.size / basis.shape[1])


def timing(simulated: np.ndarray, times: np.ndarray, records: np.ndarray, shift: float) -> np.ndarray:
    """The derivative of a reading by time within each recording, times a shift in s, (n, 1)."""
    slopes = np.zeros_like(simulated)
    for record in np.unique(records):
        own = records == record
        if own.sum() > 1:
            slopes[own] = np.gradient(simulated[own], times[own])
    return shift * slopes[:, None]


def known(directions: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    """Directions (n, k) of any length, as they come with these rms, SI."""
    lengths = np.sqrt(np.mean(directions**2, axis=0))
    return directions * np.divide(sizes, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)


def slow(times: np.ndarray, rms: float, constant: float, count: int) -> np.ndarray:
    """The largest principal directions of a slow first-order process, (n, count): its rms, SI, and time constant, s."""
    grid = np.linspace(times.min(), times.max(), GRID)
    cov = rms**2 * np.exp(-np.abs(grid[:, None] - grid) / constant)
    squares, modes = np.linalg.eigh(cov)
    largest = modes[:, ::-1][:, :count] * np.sqrt(squares[::-1][:count])
    return np.column_stack([np.interp(times, grid, mode) for mode in largest.T])


def law(contribution: np.ndarray, times: np.ndarray, share: float) -> np.ndarray:
    """What the law of an effect may miss of its contribution (n,): `share` of it, along four slow polynomials, (n, 4).

    Two of time and two of amplitude: Legendre polynomials of degree 1 and 2 over the experiment, and over the range of
    the contribution.
    """
    along = [_unit(times), _unit(contribution)]
    shapes = [legval(unit, [0.0] * degree + [1.0]) for unit in along for degree in (1, 2)]
    return share * contribution[:, None] * np.column_stack(shapes)


def _unit(values: np.ndarray) -> np.ndarray:
    """Values from -1 to 1."""
    low, high = float(values.min()), float(values.max())
    return np.zeros_like(values) if high == low else 2.0 * (values - low) / (high - low) - 1.0
