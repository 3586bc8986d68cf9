"""Stability margins of many sampled loops at once.

All crossings of a loop are bracketed on a grid and refined by bisection on the unit circle. python-control's
`stability_margins` is the reference in the tests; it looks for roots *near* the unit circle (within some
percent at the orders of these loops), so that a resonance that only comes close to a gain of one counts as a
crossing, and it takes one loop a call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Margins", "margins"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID = 2000
"""Points of the grid on half the unit circle; half of them logarithmic, for slow loops."""
_LOWEST = 1e-6  # rad a sample: the lowest frequency of the grid
_BISECTIONS = 60  # halve a bracket down to rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins:
    """Margins of n loops; each is zero where the closed loop is unstable.

    Parameters
    ----------
    gain : ndarray, shape (n,)
        Least factor by which the loop gain may grow or shrink before the closed loop turns unstable, at least
        1; infinite without a phase crossing.
    phase_deg : ndarray, shape (n,)
        Least change of phase, in degrees, that brings a gain crossing to -180°; infinite without a crossing.
    delay : ndarray, shape (n,)
        Least further delay that does so, s; infinite without a crossing.
    crossover : ndarray, shape (n,)
        Highest frequency at which the loop gain is one, rad/s; 0 without such a frequency.
    stable : ndarray of bool, shape (n,)
        Whether all closed-loop poles lie inside the unit circle.
    """

    gain: Array
    phase_deg: Array
    delay: Array
    crossover: Array
    stable: NDArray[np.bool_]


def margins(numerators: ArrayLike, denominators: ArrayLike, sample_time: float) -> Margins:
    """Compute the margins of loops ``L(z) = numerator / denominator`` under negative feedback.

    Parameters
    ----------
    numerators, denominators : array_like, shape (n, m)
        Coefficients of z^0, z^-1, ..., one loop a row; output unit by output unit (dimensionless loops).
    sample_time : float
        s.

    Returns
    -------
    Margins
        Resonances narrower than half a thousandth of the sampling rate may be missed.

    References
    ----------
    Åström & Murray, Feedback Systems (2008), section 9.3, ISBN 978-0-691-13576-2.
    """
    top, bottom = (np.atleast_2d(np.asarray(c, dtype=np.float64)) for c in (numerators, denominators))
    half = GRID // 2
    grid = np.union1d(np.geomspace(_LOWEST, np.pi, half), np.linspace(0.0, np.pi, half + 1)[1:])
    value = _evaluate(top, bottom, grid)
    stable = _stable(top, bottom)
    count = stable.size
    gain, phase, delay = (np.full(count, np.inf) for _ in range(3))
    crossover = np.zeros(count)

    # Where the locus crosses the negative real axis; at half the sampling rate it is real anyway.
    loops, angle = _crossings(top, bottom, grid, np.imag)
    ends = np.flatnonzero(value[:, -1].real < 0.0)
    loops, angle = np.concatenate([loops, ends]), np.concatenate([angle, np.full(ends.size, np.pi)])
    at = _along(top, bottom, loops, angle)
    found = at.real < 0.0
    size = np.abs(at[found])
    np.minimum.at(gain, loops[found], np.maximum(size, 1.0 / size))

    loops, angle = _crossings(top, bottom, grid, lambda v: np.abs(v) - 1.0)
    at = _along(top, bottom, loops, angle)
    np.minimum.at(phase, loops, np.degrees(np.abs(np.angle(-at))))
    np.minimum.at(delay, loops, np.mod(np.angle(-at), 2 * np.pi) / angle * sample_time)
    np.maximum.at(crossover, loops, angle / sample_time)
    for margin in (gain, phase, delay):
        margin[~stable] = 0.0
    return Margins(gain=gain, phase_deg=phase, delay=delay, crossover=crossover, stable=stable)


def _evaluate(top: Array, bottom: Array, angle: Array) -> Complex:
    """All loops at all normalised frequencies (rad), shape (n, n_angles)."""
    powers = np.exp(-1j * np.outer(np.arange(max(top.shape[1], bottom.shape[1])), angle))
    return np.asarray((top @ powers[: top.shape[1]]) / (bottom @ powers[: bottom.shape[1]]))


def _along(top: Array, bottom: Array, loops: NDArray[np.intp], angle: Array) -> Complex:
    """Chosen loops, each at a frequency of its own, shape (n_chosen,)."""
    powers = np.exp(-1j * np.outer(angle, np.arange(max(top.shape[1], bottom.shape[1]))))
    above = (top[loops] * powers[:, : top.shape[1]]).sum(axis=1)
    return np.asarray(above / (bottom[loops] * powers[:, : bottom.shape[1]]).sum(axis=1))


def _crossings(
    top: Array, bottom: Array, grid: Array, measure: Callable[[Complex], Array]
) -> tuple[NDArray[np.intp], Array]:
    """Loops and normalised frequencies at which a measure of the locus changes its sign."""
    signs = measure(_evaluate(top, bottom, grid)) > 0.0
    loops, places = np.nonzero(signs[:, 1:] != signs[:, :-1])
    low, high, before = grid[places], grid[places + 1], signs[loops, places]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        same = (measure(_along(top, bottom, loops, middle)) > 0.0) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return loops, 0.5 * (low + high)


def _stable(top: Array, bottom: Array) -> NDArray[np.bool_]:
    size = max(top.shape[1], bottom.shape[1])
    above, below = (np.pad(c, ((0, 0), (0, size - c.shape[1]))) for c in (top, bottom))
    closed = above + below
    if size == 1:
        return np.full(len(closed), True)
    companion = np.zeros((len(closed), size - 1, size - 1))
    companion[:, 1:, :-1] = np.eye(size - 2)
    companion[:, 0, :] = -closed[:, 1:] / closed[:, :1]
    return np.asarray(np.all(np.abs(np.linalg.eigvals(companion)) < 1.0, axis=1))
