"""Measure mean, drift and roughness of a simulated or measured recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.plant.errors import DataError

Array = np.ndarray
Window = tuple[float, float]
DEGREE, DEGREE_OF_RATE = 6, 3  # Degrees of the polynomials that predict a reading from a command and its rate


@dataclass(frozen=True, kw_only=True)
class Shift:
    """A shift of the mean from one time to another, at the same input."""

    size: float  # m
    error: float  # Standard error, m

    @property
    def significance(self) -> float:
        """Shift divided by its standard error."""
        return self.size / self.error


@dataclass(frozen=True, kw_only=True)
class GainChange:
    """Relative changes of gain and nonlinearity from one time to another, with their standard errors."""

    gain: float  # Relative change of the gain over all commands
    gain_error: float
    bend: float  # Relative change of the ratio of the slopes at an upper and a lower command
    bend_error: float


def moving_mean(values: ArrayLike, samples: int) -> Array:
    """Return the centred moving mean; NaN where the window is incomplete."""
    v = np.asarray(values, dtype=np.float64)
    mean = np.full(v.size, np.nan)
    if samples <= v.size:
        sums = np.concatenate([[0.0], np.cumsum(v)])
        first = samples // 2
        mean[first : first + v.size - samples + 1] = (sums[samples:] - sums[:-samples]) / samples
    return mean


def mean_shift(
    commands: ArrayLike, readings: ArrayLike, sample_time: float, early: Window, late: Window, block: float = 5.0
) -> Shift:
    """Return the shift of the mean at the same input: lines of the readings over what command and rate explain."""
    u, y = np.asarray(commands, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    expected = _expected(u, y, sample_time)
    found, variance = [], 0.0
    for window in (early, late):
        f, r = (_blocks(v, sample_time, window, block) for v in (expected - expected.mean(), y))
        level, error = _jackknife(_level, f, r)
        found.append(level)
        variance += error**2
    return Shift(size=float(found[1] - found[0]), error=float(np.sqrt(variance)))


def at_same_input(commands: ArrayLike, readings: ArrayLike, sample_time: float) -> Array:
    """Return readings minus the average effect of the command and its rate over the whole record, V and m."""
    y = np.asarray(readings, dtype=np.float64)
    return y - _expected(np.asarray(commands, dtype=np.float64), y, sample_time)


def gain_change(
    commands: ArrayLike,
    readings: ArrayLike,
    sample_time: float,
    early: Window,
    late: Window,
    at: tuple[float, float] = (2.0, 3.0),
    blocks: int = 10,
) -> GainChange:
    """Return the change of the gain, and of the ratio of slopes at two commands, from one time to another."""
    u, y = np.asarray(commands, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    expected = _expected(u, y, sample_time)
    levels = np.polynomial.Polynomial.fit(u, y, DEGREE)(np.array(at))
    found, variance = [], np.zeros(2)
    for window in (early, late):
        f, r = (_blocks(v, sample_time, window, (window[1] - window[0]) / blocks) for v in (expected, y))
        logarithms, error = _jackknife(lambda f, r: _log_slopes(f, r, levels), f, r)
        found.append(logarithms)
        variance += error**2
    change, error = np.expm1(found[1] - found[0]), np.sqrt(variance)
    (gain, bend), (gain_error, bend_error) = change.tolist(), error.tolist()
    return GainChange(gain=gain, gain_error=gain_error, bend=bend, bend_error=bend_error)


def fast_part(readings: ArrayLike, sample_time: float, above: float = 5.0) -> Array:
    """Return the part of a reading above a frequency, Hz, without delay."""
    from scipy.signal import butter, sosfiltfilt

    passed = butter(4, above, "highpass", fs=1 / sample_time, output="sos")
    return np.asarray(sosfiltfilt(passed, np.asarray(readings, dtype=np.float64)))


def roughness(readings: ArrayLike, sample_time: float, window: Window, between: tuple[float, float]) -> float:
    """Return the rms of the fast part of a reading while the reading lies between two displacements."""
    y = np.asarray(readings, dtype=np.float64)
    timepts = sample_time * np.arange(y.size)
    there = (timepts >= window[0]) & (timepts < window[1]) & (y > between[0]) & (y < between[1])
    if not there.any():
        raise DataError(f"no reading from {between[0]:g} to {between[1]:g} m between {window[0]:g} and {window[1]:g} s")
    return float(np.sqrt(np.mean(fast_part(y, sample_time)[there] ** 2)))


def _blocks(values: Array, sample_time: float, window: Window, length: float) -> Array:
    """Cut a window into complete blocks, one per row."""
    first, last = (round(edge / sample_time) for edge in window)
    size = round(length / sample_time)
    inside = values[first:last]
    return inside[: inside.size // size * size].reshape(-1, size)


def _expected(u: Array, y: Array, sample_time: float) -> Array:
    """Predict readings by a polynomial in the command, and another one times the command's rate."""
    level = (u - u.mean()) / u.std()
    rate = np.gradient(level, sample_time)
    terms = [level**k for k in range(DEGREE + 1)] + [rate * level**k for k in range(DEGREE_OF_RATE + 1)]
    table = np.stack(terms, axis=1)
    explained: Array = table @ np.linalg.lstsq(table, y, rcond=None)[0]
    return explained


def _jackknife(estimate: Callable[[Array, Array], Any], f: Array, r: Array) -> tuple[Any, Any]:
    """Return an estimate from blocks, one per row, and its standard error."""
    replicas = np.array([estimate(np.delete(f, k, 0), np.delete(r, k, 0)) for k in range(len(f))])
    return estimate(f, r), np.sqrt((len(f) - 1) * replicas.var(axis=0))


def _level(expected: Array, readings: Array) -> Any:
    """Return the value of a line through the readings where the expected reading is 0."""
    return np.polynomial.Polynomial.fit(expected.ravel(), readings.ravel(), 1)(0.0)


def _log_slopes(expected: Array, readings: Array, levels: Array) -> Array:
    """Return the logarithms of the slope of a line, and of the ratio of a parabola's slopes at two levels."""
    line, parabola = (np.polynomial.Polynomial.fit(expected.ravel(), readings.ravel(), k).deriv() for k in (1, 2))
    lower, upper = parabola(levels)
    return np.log([line(levels[0]), upper / lower])
