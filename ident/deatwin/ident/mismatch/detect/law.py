"""How large the statistics of a residual are by chance, and how large an effect must be to be seen beyond it."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.detect.null import Refit, null_residuals
from deatwin.ident.mismatch.detect.statistics import Battery, Scores

__all__ = ["LEVEL", "Law"]

LEVEL = 0.01
"""Chance of a false alarm over all statistics together."""
KEPT = 100
"""Drawn residuals that are kept to be added to effects."""
POWER = 0.9
DOUBLINGS, HALVINGS = 40, 6


class Law:
    """The statistics of residuals under which nothing is missing.

    Parameters
    ----------
    left : Leftover
        Recordings, noise and model error.
    rng : numpy.random.Generator
        Source of the draws.
    draws : int
        How many.
    """

    def __init__(self, left: Leftover, rng: np.random.Generator, draws: int) -> None:
        self.left, self.battery, self.refit = left, Battery(left), Refit(left)
        kept, pieces = [], []
        for residuals in null_residuals(left, self.refit, rng, draws):
            pieces.append(self.battery(residuals))
            if sum(piece.shape[0] for piece in kept) < KEPT:
                kept.append(residuals[:KEPT, left.fitted])
        self._kept = np.concatenate(kept)[:KEPT]
        drawn = Scores.stacked(pieces)
        self._drawn = drawn
        self._linear, self._squared, self._ratios = map(_moments, (drawn.linear, drawn.squared, drawn.ratios))
        self.spectrum = drawn.spectra.mean(axis=0)
        self._groups = np.stack(_moments(self._raw(drawn)))
        self.drawn = self.groups(drawn)
        self.largest = np.sort(self.drawn.max(axis=1))

    @property
    def critical(self) -> float:
        """Largest standardised statistic that chance exceeds once in a hundred times."""
        return float(np.quantile(self.largest, 1 - LEVEL))

    @property
    def distance(self) -> float:
        """Half width of the 99 % band about the mean cumulated periodogram."""
        mean, deviation = self._groups[:, 1]
        return float((mean + deviation * np.quantile(self.drawn[:, 1], 1 - LEVEL)) / np.sqrt(self.spectrum.size))

    @property
    def correlation(self) -> float:
        """Half width of the 99 % band of all standardised correlations with the command together."""
        mean, deviation = self._groups[:, 2]
        return float(mean + deviation * np.quantile(self.drawn[:, 2], 1 - LEVEL))

    def groups(self, scores: Scores) -> np.ndarray:
        """Largest statistic of each group, standardised.

        Parameters
        ----------
        scores : Scores
            By this law's battery.

        Returns
        -------
        ndarray, shape (b, 4)
            In the order of `statistics.GROUPS`.
        """
        return (self._raw(scores) - self._groups[0]) / self._groups[1]

    def correlations(self, scores: Scores) -> np.ndarray:
        """Standardised amplitude along each regressor.

        Parameters
        ----------
        scores : Scores
            By this law's battery.

        Returns
        -------
        ndarray, shape (b, r)
        """
        return (scores.linear - self._linear[0]) / self._linear[1]

    def p_value(self, largest: float) -> float:
        """Chance that the largest statistic is at least as large.

        Parameters
        ----------
        largest : float
            Standardised.

        Returns
        -------
        float
            Never less than one over the number of draws and one.
        """
        return float((1 + np.sum(self.largest >= largest)) / (1 + self.largest.size))

    def _raw(self, scores: Scores) -> np.ndarray:
        ratios = ((scores.ratios - self._ratios[0]) / self._ratios[1]).max(axis=1)
        distance = np.sqrt(self.spectrum.size) * np.abs(scores.spectra - self.spectrum).max(axis=1)
        linear = np.abs(self.correlations(scores)).max(axis=1)
        squared = np.abs((scores.squared - self._squared[0]) / self._squared[1]).max(axis=1)
        return np.stack([ratios, distance, linear, squared], axis=1)

    def smallest(self, change: np.ndarray, practical: float) -> float | None:
        """Strength at which an effect is detected nine times in ten, by its size or its correlations.

        Parameters
        ----------
        change : ndarray, shape (m,)
            Of the fitted part's residual after the refit, for unit strength, SI.
        practical : float
            Rms that counts, SI.

        Returns
        -------
        float or None
            None where the refit takes up all of it.
        """
        power = float(np.mean(change**2))
        if power == 0.0:
            return None
        whole = np.zeros(self.left.residual.size)
        whole[self.left.fitted] = change
        drawn, count = self._drawn, self._kept.shape[0]
        along = (whole @ self.battery.regressors)[None]
        cross, square = self._kept @ change / change.size, np.mean(self._kept**2, axis=1)

        def caught(strength: float) -> bool:
            fitted = square + 2 * strength * cross + strength**2 * power
            linear = (drawn.linear[:count] + strength * along - self._linear[0]) / self._linear[1]
            ratio = (np.log(fitted / self.left.floor) - self._ratios[0][0]) / self._ratios[1][0]
            both = np.stack([ratio, np.abs(linear).max(axis=1)], axis=1)
            largest = ((both - self._groups[0, [0, 2]]) / self._groups[1, [0, 2]]).max(axis=1)
            # Of the sensor's noise the refit has taken its share, so that it is the drawn residual that is beaten.
            size = np.sqrt(np.maximum(fitted - self.left.noise**2, 0.0))
            return bool(np.mean((largest >= self.critical) & (size >= practical)) >= POWER)

        low = 0.1 * self.left.noise / np.sqrt(power)
        high = next((low * 1.5**k for k in range(DOUBLINGS) if caught(low * 1.5**k)), None)
        if high is None or high == low:
            return high
        low = high / 1.5
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if caught(middle) else (middle, high)
        return high


def _moments(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation over draws; a statistic that never varies says nothing, so it counts as 0."""
    deviation = values.std(axis=0, ddof=1)
    return values.mean(axis=0), np.where(deviation > 1e-12, deviation, np.inf)


