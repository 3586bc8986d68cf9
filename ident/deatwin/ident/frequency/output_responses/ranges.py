"""Frequencies at which an order of the output can have energy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only, real_number, real_numbers
from deatwin.ident.frequency.checks import whole_order
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_ROUNDING = 1e-9  # gap that still counts as contact, relative to half the sampling rate or to the highest sum


def output_frequencies(band: ArrayLike, order: int, *, sample_time: float | None = None) -> Array:
    """Return the frequencies at which the n-th order of the output can have energy if the input lies in a band.

    The output frequencies are sums w_1 + ... + w_n of n input frequencies, each positive or negative. If k of them are
    negative, the sums fill the interval from (n-k) low - k high to (n-k) high - k low. A negative sum stands for the
    frequency of the same magnitude. In sampled signals, sums beyond half the sampling rate are aliased.

    Parameters
    ----------
    band : array_like, shape (2,)
        Lowest and highest angular frequency of the input, rad/s.
    order : int
        Order n, at least 1.
    sample_time : float, optional
        Sampling time, s. By default the signals are continuous, without aliasing.

    Returns
    -------
    ndarray, shape (n_intervals, 2)
        Lowest and highest angular frequency of each interval, rad/s. The intervals are disjoint and increase.

    Raises
    ------
    ModelError
        If an argument is invalid, if the band extends beyond half the sampling rate, or if the sums overflow.

    References
    ----------
    Lang, Billings, "Output frequencies of nonlinear systems", Int. J. Control 67 (1997) 713-730.

    Examples
    --------
    >>> output_frequencies([1.0, 2.0], order=2).tolist()
    [[0.0, 1.0], [2.0, 4.0]]
    """
    order = whole_order(order)
    low, high = checked_band(band, "rad/s")
    if not math.isfinite(order * high):
        raise ModelError(f"the band goes up to {high:g} rad/s; sums of {order} such frequencies overflow")
    sums = [((order - k) * low - k * high, (order - k) * high - k * low) for k in range(order + 1)]
    positive = [piece for interval in sums for piece in _magnitudes(*interval)]
    if sample_time is None:
        return _merged(positive, order * high)
    nyquist = np.pi / checked_sample_time(sample_time)
    if high > nyquist * (1 + _ROUNDING):
        raise ModelError(f"the band goes up to {high:g} rad/s, beyond half the sampling rate, {nyquist:.6g} rad/s")
    return _merged([piece for interval in positive for piece in _folded(*interval, nyquist)], nyquist)


def checked_band(band: ArrayLike, unit: str) -> tuple[float, float]:
    """Return the lowest and the highest frequency of a band after a check. Shapes: `band` (2,)."""
    values = real_numbers(band, "the band")
    if values.shape != (2,) or not (np.all(np.isfinite(values)) and 0 <= values[0] <= values[1]):
        raise ModelError(f"the band is {band!r}; it must be two numbers (low, high) in {unit} with 0 <= low <= high")
    return float(values[0]), float(values[1])


def checked_sample_time(sample_time: float) -> float:
    """Return a sampling interval after a check."""
    found = real_number(sample_time, "sample_time")
    if not 0 < found < math.inf:
        raise ModelError(f"sample_time = {sample_time}; it must be positive, in s")
    return found


def _magnitudes(low: float, high: float) -> list[tuple[float, float]]:
    """Return the absolute values of an interval that may contain both signs."""
    if low >= 0:
        return [(low, high)]
    return [(-high, -low)] if high <= 0 else [(0.0, max(-low, high))]


def _folded(low: float, high: float, nyquist: float) -> list[tuple[float, float]]:
    """Cut an interval at multiples of half the sampling rate, and reverse every second piece."""
    first = math.floor(low / nyquist)
    last = max(math.ceil(high / nyquist), first + 1)
    pieces = []
    for m in range(first, last):
        start, end = (min(max(w - m * nyquist, 0.0), nyquist) for w in (low, high))
        pieces.append((start, end) if m % 2 == 0 else (nyquist - end, nyquist - start))
    return pieces


def _merged(intervals: list[tuple[float, float]], scale: float) -> Array:
    """Join intervals that overlap or touch."""
    joined: list[list[float]] = []
    for low, high in sorted(intervals):
        if joined and low <= joined[-1][1] + _ROUNDING * scale:
            joined[-1][1] = max(joined[-1][1], high)
        else:
            joined.append([low, high])
    return read_only(joined)
