"""Squared residuals in blocks: the units in which a diagnosis counts evidence.

Samples of a residual that is more than white noise are not independent. Blocks of about a second are nearly so,
and every test of the mismatch engine counts blocks, never samples.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

BLOCK_SAMPLES = 50
RESAMPLES = 2000


def block_losses(residuals: np.ndarray) -> np.ndarray:
    """Return the mean square of a residual in consecutive blocks.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        In order.

    Returns
    -------
    ndarray, shape (b,)
        Squares of the residual's unit; at least eight blocks where there are as many samples.
    """
    size = max(1, min(BLOCK_SAMPLES, residuals.size // 8))
    count = residuals.size // size
    return (residuals[: count * size] ** 2).reshape(count, size).mean(axis=1)


def exceeds(losses: np.ndarray, floor: float) -> float:
    """Test whether the mean loss is larger than a limit.

    Parameters
    ----------
    losses : ndarray, shape (b,)
        Block losses.
    floor : float
        What noise and model error account for, in the same unit.

    Returns
    -------
    float
        One-sided p-value of a mean of correlated blocks: its variance is Newey and West's with the cube root of b lags,
        whose scatter leaves Student's law with as many degrees of freedom as Bartlett's window has.

    References
    ----------
    Newey & West, Econometrica 55 (1987) 703, doi:10.2307/1913610; degrees of freedom, at frequency 0 half of
    3 b over the width: Priestley, Spectral Analysis and Time Series (1981), 6.2.4.
    """
    centred = losses - losses.mean()
    lags = round(losses.size ** (1 / 3))
    variance = np.mean(centred**2)
    for lag in range(1, lags + 1):
        variance += 2 * (1 - lag / (lags + 1)) * np.mean(centred[lag:] * centred[:-lag])
    deviation = np.sqrt(max(variance, 1e-300) / losses.size)
    return float(stdtr(1.5 * losses.size / (lags + 1), (floor - losses.mean()) / deviation))


def evidence(losses: np.ndarray, parameters: int) -> float:
    """Return the log evidence for a model, by Schwarz' approximation with one observation per block.

    Parameters
    ----------
    losses : ndarray, shape (b,)
        Block losses of the model.
    parameters : int
        Number of its fitted parameters.

    Returns
    -------
    float
        In nats; only differences mean anything.

    References
    ----------
    Schwarz, Ann. Statist. 6 (1978) 461, doi:10.1214/aos/1176344136.
    """
    return float(-losses.size / 2 * np.log(losses.mean()) - parameters / 2 * np.log(losses.size))


def bootstrap_gain(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> float:
    """Return the lower 95 % bound of the decrease of the rms error, by a paired moving-block bootstrap.

    Runs of as many neighbouring losses as the square root of their number are drawn together, since a slow
    residual ties neighbours.

    Parameters
    ----------
    before, after : ndarray, shape (b,)
        Block losses of two models on the same samples.
    rng : numpy.random.Generator
        Source of the resampling.

    Returns
    -------
    float
        In the residual's unit.

    References
    ----------
    Politis & Romano (1992), circular block-resampling.
    """
    count = before.size
    run = max(1, round(np.sqrt(count)))
    starts = rng.integers(0, count, size=(RESAMPLES, -(-count // run)))
    picks = ((starts[:, :, None] + np.arange(run)) % count).reshape(RESAMPLES, -1)[:, :count]
    gains = np.sqrt(before[picks].mean(axis=1)) - np.sqrt(after[picks].mean(axis=1))
    return float(np.quantile(gains, 0.05))
