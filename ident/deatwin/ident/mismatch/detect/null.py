"""Residuals of an adequate plant, drawn by a parametric bootstrap [2]_ with a linearised refit.

A drawn residual e* is sensor noise and model error, minus the part that a refit to the fitted data removes to first
order: e* - J J+ e*.

The noise has the estimated level, and the colour of the residual above the band in which the plant moves: white, or
autoregressive with the order chosen by Schwarz' criterion, by Whittle's likelihood [1]_.

The model error is a smooth random function of the simulated reading and of its past: a polynomial of low degree in the
reading and in the lagged reading, with lags from two samples to a tenth of the record. The variance of a term halves
with each degree. The difference between a refitted reduced plant and a finer one is of this kind: the parameters absorb
its static part, and the rest is smooth in the motion and its past. After the refit its mean square is the stated one on
average; a single draw may have half or twice as much, because it is not known better.

References
----------
.. [1] Whittle, "Estimation and information in stationary time series", Ark. Mat. 2 (1953) 423-434,
   doi:10.1007/BF02590998.
.. [2] Davison, Hinkley, "Bootstrap Methods and their Application" (1997), chapter 4.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize

from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.likelihood.structured import unit_range
from deatwin.ident.mismatch.thresholds import ROUNDING, SEGMENT_SAMPLES, TINY

ORDERS = (0, 1, 2, 3)
STABLE = 1.0 - 1e-4
"""Largest partial correlation of the noise. A hyperbolic tangent rounds to 1, at which the noise would never decay."""
MOVING = 0.995
"""Share of the simulated readings' power below the band in which the noise's colour is estimated."""
QUIET_BAND = 0.6
"""Highest lower end of that band, as a share of the Nyquist frequency."""
SHORTEST_SAMPLES = 64
"""Smallest number of sound samples from which a spectrum is estimated."""
DEGREE = 4
MEMORIES = 6
"""Number of lags that the model error may have; each draw has one of them."""
FREEDOMS = 4
"""Degrees of freedom of the chi-squared distribution of a draw's mean square."""
CHUNK = 2_000_000
"""Number of random numbers that are drawn at once."""
BURN_IN = 200


class Refit:
    """Linearised refit of residuals to the fitted part.

    `white`, (n,), is the variance of unit white noise after it: smaller in fitted data, larger in held-out data.
    """

    def __init__(self, left: Leftover) -> None:
        scale = np.linalg.norm(left.jacobian, axis=0)
        self._jacobian = left.jacobian / np.where(scale > 0, scale, 1.0)
        self._fitted = left.fitted
        tall, small = np.linalg.qr(self._jacobian[left.fitted])
        inverse = np.linalg.pinv(small, rcond=ROUNDING)
        self._inverse = inverse @ tall.T
        leverage = np.sum((self._jacobian @ inverse) ** 2, axis=1)
        self.white = np.where(left.fitted, 1.0 - leverage, 1.0 + leverage)

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """Return residuals after the refit. Shapes: (b, n) both."""
        return residuals - (residuals[:, self._fitted] @ self._inverse.T) @ self._jacobian.T


def null_residuals(left: Leftover, refit: Refit, rng: np.random.Generator, draws: int) -> Iterator[np.ndarray]:
    """Yield blocks, (b, n), of residuals of a plant that lacks nothing, SI, with this number of `draws` in total."""
    from scipy.signal import lfilter

    n = left.residual.size
    filtering, deviation = colour(left)
    error = _ModelError(left, refit) if left.model_error > 0.0 else None
    size = max(1, CHUNK // n)
    for begin in range(0, draws, size):
        count = min(size, draws - begin)
        white = rng.standard_normal((count, n + BURN_IN))
        noise = left.noise * deviation * lfilter([1.0], filtering, white, axis=1)[:, BURN_IN:]
        drawn = refit(noise)
        if error is not None:
            drawn += error.draw(rng, count)
        yield drawn


class _ModelError:
    """Random model errors, after the refit."""

    def __init__(self, left: Leftover, refit: Refit) -> None:
        terms, self._memory = error_terms(left)
        self._terms = refit(terms.T)
        self._average = left.fitted / left.fitted.sum()
        self._rms = left.model_error

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Draw model errors, shape (count, n), SI."""
        chosen = rng.integers(1, MEMORIES + 1, size=(count, 1))
        weights = rng.standard_normal((count, self._memory.size))
        weights *= (self._memory == 0) | (self._memory == chosen)
        errors = weights @ self._terms
        power = errors**2 @ self._average
        wanted = self._rms**2 * rng.chisquare(FREEDOMS, count) / FREEDOMS
        return np.asarray(errors * np.sqrt(wanted / np.maximum(power, TINY))[:, None])


def error_terms(left: Leftover) -> tuple[np.ndarray, np.ndarray]:
    """Return the basis of the Gaussian prior on the model error, before the refit.

    Shapes: terms (n, k), without scale; the number of each term's lag (k,), from 1, or 0 if the term is static.
    """
    reading = unit_range(left.readings)
    longest = max(r.stop - r.start for r in left.records)
    columns = [2.0 ** (-degree / 2) * _legendre(reading, degree) for degree in range(1, DEGREE + 1)]
    memory = [0] * DEGREE
    for number, lag in enumerate(np.geomspace(2, max(8, longest / 10), MEMORIES), start=1):
        past = np.concatenate([_lagged(reading[r], lag) for r in left.records])
        for one in range(DEGREE):
            for other in range(1, DEGREE + 1 - one):
                columns.append(2.0 ** (-(one + other) / 2) * _legendre(reading, one) * _legendre(past, other))
                memory.append(number)
    return np.stack(columns, axis=1), np.array(memory)


def colour(left: Leftover) -> tuple[np.ndarray, float]:
    """Estimate the colour of the noise, an autoregression, from the residual above the band of the motion.

    Returns its coefficients 1, a_1, ..., (p + 1,), and the deviation of the driving noise for a noise of unit variance.
    """
    frequency, density, averages = _welch(left)
    if not density.all():
        return np.ones(1), 1.0  # without noise there is no colour
    above = frequency >= _quiet_from(left, frequency)
    best, chosen = np.inf, np.ones(1)
    seen = (frequency[above], density[above], averages)
    for order in ORDERS:
        found = minimize(_whittle, np.zeros(order), args=seen).x if order else np.zeros(0)
        cost = _whittle(found, *seen) + (order + 1) * np.log(averages * above.sum())
        if cost < best:
            best, chosen = cost, _autoregression(found)
    response = np.mean(1 / _gain(chosen, np.linspace(0.0, 0.5, 2049)))
    return chosen, float(1 / np.sqrt(response))


def _whittle(reflections: np.ndarray, frequency: np.ndarray, density: np.ndarray, averages: float) -> float:
    """Return twice the negative log likelihood of a spectrum, with the best level."""
    shape = 1 / _gain(_autoregression(reflections), frequency)
    level = np.mean(density / shape)
    return float(2 * averages * np.sum(np.log(shape * level) + density / (shape * level)))


def _autoregression(reflections: np.ndarray) -> np.ndarray:
    """Return coefficients from partial correlations, which are hyperbolic tangents of any numbers (Levinson)."""
    found = np.ones(1)
    for k in STABLE * np.tanh(reflections):
        padded = np.append(found, 0.0)
        found = padded + k * padded[::-1]
    return found


def _gain(filtering: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Return the squared modulus of the filter at frequencies in cycles per sample."""
    delays = np.exp(-2j * np.pi * frequency[:, None] * np.arange(filtering.size))
    return np.asarray(np.abs(delays @ filtering) ** 2)


def _welch(left: Leftover) -> tuple[np.ndarray, np.ndarray, float]:
    """Return frequencies (cycles per sample), spectrum of the residual, and the number of averaged periodograms."""
    from scipy.signal import welch

    longest = max(r.stop - r.start for r in left.records)
    records = [r for r in left.records if r.stop - r.start >= min(SHORTEST_SAMPLES, longest)]
    segment = min(SEGMENT_SAMPLES, *(r.stop - r.start for r in records))
    total, weight = np.zeros(segment // 2 + 1), 0.0
    frequency = np.zeros(segment // 2 + 1)
    for r in records:
        frequency, density = welch(left.residual[r], 1.0, nperseg=segment)
        total, weight = total + density * (r.stop - r.start), weight + (r.stop - r.start)
    # Half-overlapping Hann segments are correlated, so only independent ones are counted.
    return frequency[1:-1], total[1:-1] / weight, max(1.0, weight / segment)


def _quiet_from(left: Leftover, frequency: np.ndarray) -> float:
    """Return the frequency above which the simulated readings hardly move."""
    from scipy.signal import welch

    power = np.zeros(frequency.size)
    for r in left.records:
        power += np.interp(frequency, *welch(left.readings[r], 1.0, nperseg=min(4 * SEGMENT_SAMPLES, r.stop - r.start)))
    share = np.cumsum(power) / max(power.sum(), TINY)
    still = min(int(np.searchsorted(share, MOVING)), frequency.size - 1)
    return min(float(frequency[still]), QUIET_BAND / 2)


def _lagged(signal: np.ndarray, lag: float) -> np.ndarray:
    """Return a signal after a first-order lag of some samples, at rest at its first value."""
    from scipy.signal import lfilter

    share = 1 - np.exp(-1 / lag)
    return np.asarray(lfilter([share], [1.0, share - 1.0], signal - signal[0]) + signal[0])


def _legendre(signal: np.ndarray, degree: int) -> np.ndarray:
    return np.polynomial.legendre.legval(signal, np.eye(degree + 1)[degree])
