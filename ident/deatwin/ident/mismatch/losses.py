"""Squared residuals in blocks: the units in which a diagnosis counts evidence.

Samples of a residual that is more than white noise are not independent. Blocks of about a second are nearly so,
and every test of the mismatch engine counts blocks, never samples.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from deatwin.ident.mismatch.thresholds import BLOCK_SAMPLES, CHANCE, TINY

RESAMPLES = 2000


def block_length(count: int) -> int:
    """Return the number of samples in a block, so that there are at least eight blocks if samples suffice."""
    return max(1, min(BLOCK_SAMPLES, count // 8))


def block_losses(residuals: np.ndarray) -> np.ndarray:
    """Return the mean squares, (b,), of a residual, (n,), in consecutive blocks."""
    size = block_length(residuals.size)
    count = residuals.size // size
    return (residuals[: count * size] ** 2).reshape(count, size).mean(axis=1)


def exceeds(losses: np.ndarray, floor: float) -> float:
    """Return the one-sided p-value of a mean of correlated block losses, (b,), that is no larger than a floor."""
    # The variance is that of Newey and West (Econometrica 55 (1987) 703, doi:10.2307/1913610) with the cube root of b
    # lags. Since it scatters, the statistic has Student's distribution, with the degrees of freedom of Bartlett's
    # window at frequency 0: half of 3 b over the width (Priestley, Spectral Analysis and Time Series (1981), 6.2.4).
    centred = losses - losses.mean()
    lags = round(losses.size ** (1 / 3))
    variance = np.mean(centred**2)
    for lag in range(1, lags + 1):
        # Divided by b, not by the number of products: otherwise the variance may be negative.
        variance += 2 * (1 - lag / (lags + 1)) * (centred[lag:] @ centred[:-lag]) / losses.size
    deviation = np.sqrt(max(variance, TINY) / losses.size)
    return float(stdtr(1.5 * losses.size / (lags + 1), (floor - losses.mean()) / deviation))


def evidence(losses: np.ndarray, parameters: int) -> float:
    """Return the log evidence for a model, nats, up to a constant: Schwarz' approximation, one observation a block."""
    # Schwarz, Ann. Statist. 6 (1978) 461, doi:10.1214/aos/1176344136.
    return float(-losses.size / 2 * np.log(losses.mean()) - parameters / 2 * np.log(losses.size))


def bootstrap_gain(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> float:
    """Return the lower 95 % bound of how much the rms error falls, from block losses before and after, (b,) each."""
    # This is a paired circular block bootstrap (Politis & Romano 1992). A slow residual correlates neighbours, so as
    # many neighbouring losses as the square root of their number are drawn together.
    count = before.size
    run = max(1, round(np.sqrt(count)))
    starts = rng.integers(0, count, size=(RESAMPLES, -(-count // run)))
    picks = ((starts[:, :, None] + np.arange(run)) % count).reshape(RESAMPLES, -1)[:, :count]
    gains = np.sqrt(before[picks].mean(axis=1)) - np.sqrt(after[picks].mean(axis=1))
    return float(np.quantile(gains, CHANCE))
