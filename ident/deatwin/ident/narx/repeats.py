"""Find the period of a repeating signal, and separate the repeating part from differences between periods."""

from __future__ import annotations

import math

import numpy as np

from deatwin.plant.arrays import Array

# Largest mean squared difference of a signal from itself a period later, as a share of twice the variance: noise of a
# seventh of the signal's deviation causes as much.
_ALIKE = 0.02
_FINER = 8  # Shifts per sample: half of one costs 0.6 % of twice the variance even of a tone of 4 samples


def period_of(values: Array) -> float | None:
    """Return the number of samples after which a signal repeats, at least twice; None if it does not."""
    found = _repeats(values)
    return None if found is None else found[0] / found[1]


def whole_period_of(values: Array) -> int | None:
    """Return the fewest whole periods that are a whole number of samples; None without a period."""
    found = _repeats(values)
    return None if found is None else whole_multiple(found[0] / found[1], values.size // 2)


def whole_multiple(period: float, longest: int, drift: float = 0.5) -> int:
    """Return the fewest whole periods that deviate from whole samples by at most `drift` over `longest`, in samples."""
    times = max(int((longest + 0.5) // period), 1)
    off = (abs(m * period - round(m * period)) * times / m for m in range(1, times + 1))
    return round(period * next((m for m, one in enumerate(off, 1) if one <= drift), times))


def _repeats(values: Array) -> tuple[float, int] | None:
    """Return a number of samples and the number of whole periods in it; None without repetition throughout."""
    n, left = values.size, values - values.mean()
    size = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(left, size)) ** 2
    shifts = np.arange((n // 2 + n // 8) * _FINER + 1) / _FINER
    products = np.fft.irfft(power, _FINER * size)[: shifts.size] * _FINER
    squares = np.concatenate([[0.0], np.cumsum(left**2)])
    sums = np.interp(n - shifts, np.arange(n + 1), squares) + squares[n]
    sums -= np.interp(shifts, np.arange(n + 1), squares)
    apart = (sums - 2.0 * products) / np.maximum(sums, np.finfo(float).tiny)  # 0 for equal, 1 for unrelated signals
    half = n // 2 * _FINER
    other = np.flatnonzero(apart[: half + 1] > 0.5)
    alike = other[0] + np.flatnonzero(apart[other[0] : half + 1] <= _ALIKE) if other.size else other
    if not alike.size:
        return None
    first = int(alike[0])
    first += int(np.argmin(apart[first : first + max(_FINER, first // 4)]))
    times, period, width, last = max(half // first, 1), float(first), max(_FINER, first // 4), first
    for count in [*(2**k for k in range(1, times.bit_length()) if 2**k < times), times]:
        begin = max(round(count * period) - width, 1)
        last = begin + int(np.argmin(apart[begin : round(count * period) + width + 1]))
        period = last / count
    if apart[last] > 2.0 * _ALIKE:
        return None
    whole = round(last / _FINER) * _FINER
    # A shift between samples is taken only if the signals are clearly more alike there than at a whole sample.
    return (last if whole >= apart.size or abs(apart[last]) < 0.5 * apart[whole] else whole) / _FINER, times


def periods_apart(values: Array, inputs: Array, output: Array, lags: int) -> list[tuple[Array, Array]]:
    """Separate a record into its repeating part, first, and differences between its blocks of whole periods, by
    Helmert's orthonormal matrix, which leaves stationary noise independent; a record with no period beyond the lags stays
    whole. Shapes: `values` (n,), `inputs` (n_inputs, n), `output` (n,)."""
    period = whole_period_of(values) or 0
    if period <= lags:
        return [(inputs, output)]
    lengths = range(period, values.size // 2 + 1, period)
    length = max(lengths, key=lambda one: (values.size // one - 1) * (one - lags))  # most samples with lags before them
    count = values.size // length
    rows = np.vstack([inputs, output])[:, : count * length].reshape(-1, count, length)
    made = [rows.mean(axis=1) * math.sqrt(count)]
    made += [(rows[:, k] - rows[:, :k].mean(axis=1)) * math.sqrt(k / (k + 1)) for k in range(1, count)]
    return [(one[:-1], one[-1]) for one in made]
