"""Tests of stationarity on the segments of a signal: for a trend, a change, and any spread beyond chance.

For a model of constant parameters, mean, variance and fast power must stay: means over a segment of y, (y - mean)^2 and
(y(k) - y(k-1))^2 (Bendat and Piersol, Random Data, 4th ed., 2010, sections 4.5.2 and 10.3.1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from deatwin.plant.arrays import Array

STATISTICS = ("mean", "variance", "fast variance")
ENOUGH_CORRELATION_TIMES = 15.0  # Length of a segment, in correlation times, from which on the tests keep their level
_SMALLEST_GROUP = 3  # least segments before or after a change


@dataclass(frozen=True, eq=False)
class SegmentMeans:
    """Statistic of each segment with its sampling variance."""

    values: Array
    chance: Array

    def part(self, first: int, last: int) -> SegmentMeans:
        """Return the segments ``first`` to ``last - 1``."""
        return SegmentMeans(self.values[first:last], self.chance[first:last])


def segment_means(signal: Array, n_segments: int) -> tuple[SegmentMeans, ...]:
    """Return the statistics of the segments of a signal, in the order of `STATISTICS`. Shapes: `signal` (n,)."""
    segments = cut(signal, n_segments)
    mean = segments.mean(axis=1, keepdims=True)
    squares = (segments - mean) ** 2, np.diff(segments, axis=1) ** 2
    return (SegmentMeans(mean[:, 0], chance_of_mean(segments)), *(_relative(square) for square in squares))


def _relative(square: Array) -> SegmentMeans:
    """Return three times the cube root (Wilson and Hilferty): nearly normal, with the mean's relative variance."""
    power = square.mean(axis=1, keepdims=True)
    power = np.maximum(power, np.finfo(float).eps * max(float(power.max()), np.finfo(float).tiny))
    return SegmentMeans(3.0 * np.cbrt(power[:, 0] / power.mean()), chance_of_mean(square / power))


def cut(signal: Array, n_segments: int) -> Array:
    """Cut a signal (n,) into complete segments, shape (n_segments, length)."""
    length = signal.size // n_segments
    return signal[: n_segments * length].reshape(n_segments, length)


def chance_of_mean(segments: Array) -> Array:
    """Return the variance of each segment's mean, (n_segments,), from its lowest periodogram line."""
    length = segments.shape[1]
    slowest = np.fft.rfft(segments, axis=1)[:, 1]
    return np.asarray(np.abs(slowest) ** 2 / length**2, dtype=np.float64)


def correlation_samples(segments: Array) -> float:
    """Return the integral time scale within segments (n_segments, length), in samples, up to the first zero."""
    length = segments.shape[1]
    left = segments - segments.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(left, 2 * length, axis=1)) ** 2
    products = np.fft.irfft(power.mean(axis=0))[:length]
    if products[0] <= 0.0:
        return 0.0
    correlation = products / products[0] * length / np.arange(length, 0, -1)
    zero = int(np.argmax(correlation <= 0.0)) or length
    return 1.0 + 2.0 * float(correlation[1:zero].sum())


def trend_p_value(data: SegmentMeans) -> float:
    """Return the two-sided p-value of the reverse arrangements, exact for independent values of any distribution."""
    values = data.values
    larger = (np.sign(values[:, None] - values[None, :]) + 1.0) / 2.0  # a tie counts half
    count = float(np.sum(np.triu(larger, k=1)))
    law = _inversion_law(values.size)
    mean = values.size * (values.size - 1) / 4
    return float(law[np.abs(np.arange(law.size) - mean) >= abs(count - mean) - 1e-9].sum())


def change_p_value(data: SegmentMeans) -> float:
    """Return the p-value of the largest difference of segments before and after a time (t test, Bonferroni)."""
    from scipy.special import stdtr

    n = data.values.size
    cuts = np.arange(_SMALLEST_GROUP, n - _SMALLEST_GROUP + 1)
    before = np.cumsum(data.values)[cuts - 1] / cuts
    after = (data.values.sum() - before * cuts) / (n - cuts)
    between = (before - after) ** 2 * cuts * (n - cuts) / n
    within = np.maximum(data.values.var() * n - between, np.finfo(float).tiny)
    ratio = np.sqrt(between / (within / (n - 2)))
    return min(1.0, 2 * float(stdtr(n - 2, -ratio.max())) * cuts.size)


def spread_p_value(data: SegmentMeans) -> float:
    """Return the p-value of the variance of the values relative to their sampling variance (F test)."""
    from scipy.special import fdtrc

    n = data.values.size
    ratio = data.values.var(ddof=1) / max(float(data.chance.mean()), np.finfo(float).tiny)
    return float(fdtrc(n - 1, 2 * n, ratio))


TESTS: Mapping[str, Callable[[SegmentMeans], float]] = MappingProxyType(
    {"trend": trend_p_value, "change": change_p_value, "spread": spread_p_value}
)


@lru_cache(maxsize=64)
def _inversion_law(n: int) -> Array:
    """Return the probabilities of 0, 1, ... inversions of a random permutation of n."""
    law = np.ones(1)
    for k in range(2, n + 1):
        law = np.convolve(law, np.full(k, 1.0 / k))
    law.setflags(write=False)
    return law
