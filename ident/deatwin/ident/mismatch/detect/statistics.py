"""Statistics of a residual: its size, its spectrum, and its correlation with the command.

References
----------
.. [1] Bartlett, "An Introduction to Stochastic Processes" (1955), the cumulative periodogram.
.. [2] Billings, Voon, "Correlation based model validity tests for non-linear models", Int. J. Control 44 (1986)
   235-244, doi:10.1080/00207178608933593.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len, rfft

from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.thresholds import TINY

LAGS = 9
"""Number of lags: 0, 1, 4, 16, ... samples, as far as a tenth of the longest recording."""
GROUPS = ("variance ratio", "cumulative periodogram", "correlation with the command", "correlation of the square")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """All statistics of some residuals, before they are standardised."""

    linear: np.ndarray  # (b, r), correlation of residual and regressor times the square root of the number of samples
    squared: np.ndarray  # (b, r), likewise for the square of the residual
    ratios: np.ndarray  # (b, 1 or 2), log of the mean square over the floor, of the fitted and of the held-out part
    spectra: np.ndarray  # (b, f), cumulated periodograms, from 0 to 1

    @classmethod
    def stacked(cls, pieces: Sequence[Scores]) -> Scores:
        """Join scores of several sets of residuals by the same battery."""
        names = ("linear", "squared", "ratios", "spectra")
        return cls(**{name: np.concatenate([getattr(p, name) for p in pieces]) for name in names})


class Battery:
    """Statistics of any residuals on given recordings, of which only the signals are used, not their own residual."""

    def __init__(self, left: Leftover) -> None:
        self.left = left
        self.names, columns = _regressors(left)
        self.regressors = columns / np.sqrt(columns.shape[0])
        parts = [part for part in (left.fitted, ~left.fitted) if part.any()]
        self._averages = np.stack([part / part.sum() for part in parts], axis=1)
        self.lines = next_fast_len(left.residual.size, real=True)

    def __call__(self, residuals: np.ndarray) -> Scores:
        """Return all statistics of residuals, (b, n), SI."""
        squares = residuals**2
        power = np.maximum(squares.mean(axis=1, keepdims=True), TINY)
        scatter = np.sqrt(np.maximum((squares**2).mean(axis=1, keepdims=True) - power**2, TINY))
        return Scores(
            linear=residuals @ self.regressors / np.sqrt(power),
            # the regressors have zero mean, so the mean of the squares has no effect
            squared=squares @ self.regressors / scatter,
            ratios=np.log(np.maximum(squares @ self._averages, TINY) / self.left.floor),
            spectra=self._cumulated(residuals),
        )

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Frequencies of the cumulative periodogram, shape (f,), Hz."""
        return np.fft.rfftfreq(self.lines, self.left.sample_time)[1:]

    def _cumulated(self, residuals: np.ndarray) -> np.ndarray:
        power = (
            np.abs(rfft(residuals, n=self.lines, axis=1)[:, 1:]) ** 2 + TINY
        )  # without a residual, that of white noise
        total = np.cumsum(power, axis=1)
        return total / total[:, -1:]


def _regressors(left: Leftover) -> tuple[tuple[str, ...], np.ndarray]:
    """Return command, rate and their powers at several lags, and time, each with mean 0 and variance 1."""
    level = _standard(left.commands)
    rate = _standard(np.concatenate([np.gradient(level[r]) if level[r].size > 1 else level[r] for r in left.records]))
    signals = {
        "u": level,
        "u^2": level**2,
        "u^3": level**3,
        "u'": rate,
        "u'^2": rate**2,
        "u'^3": rate**3,
        "u u'": level * rate,
    }
    names, columns = ["time"], [_standard(left.timepts)]
    for name, signal in signals.items():
        for lag in _lags(left):
            names.append(f"{name} {lag * left.sample_time:.3g} s ago" if lag else name)
            columns.append(_standard(_delayed(_standard(signal), left.records, lag)))
    return tuple(names), np.stack(columns, axis=1)


def _lags(left: Leftover) -> list[int]:
    longest = max(r.stop - r.start for r in left.records) // 10
    return [0, *(lag for lag in (4**k for k in range(LAGS - 1)) if lag <= longest)]


def _delayed(signal: np.ndarray, records: Sequence[slice], lag: int) -> np.ndarray:
    """Return a delayed signal, 0 before its recording began."""
    found = np.zeros(signal.size)
    for r in records:
        found[r.start + lag : r.stop] = signal[r.start : max(r.start, r.stop - lag)]
    return found


def _standard(signal: np.ndarray) -> np.ndarray:
    centred = signal - signal.mean()
    deviation = float(centred.std())
    return centred / deviation if deviation > 1e-12 * float(np.abs(signal).max() + TINY) else np.zeros(signal.size)
