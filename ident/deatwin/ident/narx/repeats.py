"""Find the period of a signal that repeats itself, and separate what repeats from what differs between periods."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ALIKE = 0.02
"""Share of twice the variance by which a signal differs from itself a period later, at most: a tone of 16 samples whose
period is half a sample off the clock differs by as much."""


def period_of(values: Array) -> float | None:
    """Return the number of samples after which a signal repeats itself, at least twice; None where it does not."""
    found = _repeats(values)
    return None if found is None else found[0] / found[1]


def _repeats(values: Array) -> tuple[int, int] | None:
    """Return a whole number of samples, and the whole number of periods in it; None where a signal does not repeat itself.

    The signal is compared with itself at all shifts, from the first one at which it has become another on, and for the
    last time half the record later, so that slow growth does not pass for repetition.
    """
    n, left = values.size, values - values.mean()
    size = 1 << (2 * n - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(left, size)) ** 2, size)[: n // 2 + 1]
    squares = np.concatenate([[0.0], np.cumsum(left**2)])
    shifts = np.arange(products.size)
    sums = squares[n - shifts] + squares[n] - squares[shifts]
    apart = (sums - 2.0 * products) / np.maximum(sums, np.finfo(float).tiny)  # 0: alike, 1: as two signals
    other = np.flatnonzero(apart > 0.5)
    alike = other[0] + np.flatnonzero(apart[other[0] :] <= _ALIKE) if other.size else other
    if not alike.size:
        return None
    first = int(alike[0])
    first += int(np.argmin(apart[first : first + max(1, first // 4)]))
    times = (n // 2) // first
    about, width = times * first, max(1, first // 4)
    last = about - width + int(np.argmin(apart[about - width : about + width + 1]))
    return (last, times) if apart[last] <= 2.0 * _ALIKE else None


def periods_apart(values: Array, inputs: Array, output: Array, lags: int) -> list[tuple[Array, Array]]:
    """Separate a record into what repeats itself, first, and what differs between its blocks of whole periods.

    The blocks are put together by Helmert's orthonormal matrix: the first series is their mean, the others are a block
    less the mean of those before it. Stationary noise remains noise of the same law in each, and independent between
    them; what repeats itself, linear or not, is in the first alone. Blocks are as long as leaves most samples that have
    so many `lags`. A record that does not repeat itself, or does within the lags, which then tell what comes, is
    returned whole. Shapes: `values` (n,), `inputs` (n_inputs, n), `output` (n,).
    """
    found = _repeats(values)
    period = 0 if found is None else found[0] // math.gcd(*found)  # a whole number of samples
    if period <= lags:
        return [(inputs, output)]
    lengths = range(period, values.size // 2 + 1, period)
    length = max(lengths, key=lambda one: (values.size // one - 1) * (one - lags))
    count = values.size // length
    rows = np.vstack([inputs, output])[:, : count * length].reshape(-1, count, length)
    made = [rows.mean(axis=1) * math.sqrt(count)]
    made += [(rows[:, k] - rows[:, :k].mean(axis=1)) * math.sqrt(k / (k + 1)) for k in range(1, count)]
    return [(one[:-1], one[-1]) for one in made]
