"""Distribution of the statistics of a residual under chance."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.detect.null import Refit, null_residuals
from deatwin.ident.mismatch.detect.statistics import Battery, Scores
from deatwin.ident.mismatch.thresholds import SIGNIFICANCE

KEPT = 100
"""Number of drawn residuals that are kept, to which effects are added later."""


class Law:
    """Distribution of the statistics of residuals if nothing is missing, from this number of random `draws`."""

    def __init__(self, left: Leftover, rng: np.random.Generator, draws: int) -> None:
        self.left, self.battery, self.refit = left, Battery(left), Refit(left)
        kept: list[np.ndarray] = []
        pieces: list[Scores] = []
        for residuals in null_residuals(left, self.refit, rng, draws):
            pieces.append(self.battery(residuals))
            if sum(piece.shape[0] for piece in kept) < KEPT:
                kept.append(residuals[:KEPT])
        self.kept = np.concatenate(kept)[:KEPT]  # (k, n), some of the drawn residuals, SI
        drawn = Scores.stacked(pieces)
        # means and standard deviations of the statistics over the draws
        self.linear, self.squared, self.ratios = map(_moments, (drawn.linear, drawn.squared, drawn.ratios))
        self.spectrum = drawn.spectra.mean(axis=0)  # (f,), mean cumulative periodogram
        self.moments = np.stack(_moments(self._raw(drawn)))  # (2, 4), of the largest statistic of each group
        self.drawn = self.groups(drawn)  # (b, 4)
        self.largest = np.sort(self.drawn.max(axis=1))

    @property
    def critical(self) -> float:
        """Standardised statistic that chance exceeds once in a hundred times."""
        return float(np.quantile(self.largest, 1 - SIGNIFICANCE))

    @property
    def distance(self) -> float:
        """Half width of the 99 % band about the mean cumulative periodogram."""
        mean, deviation = self.moments[:, 1]
        return float((mean + deviation * np.quantile(self.drawn[:, 1], 1 - SIGNIFICANCE)) / np.sqrt(self.spectrum.size))

    @property
    def correlation(self) -> float:
        """Half width of the joint 99 % band of all standardised correlations with the command."""
        mean, deviation = self.moments[:, 2]
        return float(mean + deviation * np.quantile(self.drawn[:, 2], 1 - SIGNIFICANCE))

    def groups(self, scores: Scores) -> np.ndarray:
        """Return the largest statistic of each group, standardised, (b, 4), in the order of `statistics.GROUPS`."""
        return (self._raw(scores) - self.moments[0]) / self.moments[1]

    def correlations(self, scores: Scores) -> np.ndarray:
        """Return the standardised amplitude along each regressor, (b, r)."""
        return (scores.linear - self.linear[0]) / self.linear[1]

    def p_value(self, largest: float) -> float:
        """Return the probability that chance makes the largest standardised statistic at least this large."""
        return float((1 + np.sum(self.largest >= largest)) / (1 + self.largest.size))

    def _raw(self, scores: Scores) -> np.ndarray:
        ratios = ((scores.ratios - self.ratios[0]) / self.ratios[1]).max(axis=1)
        distance = np.sqrt(self.spectrum.size) * np.abs(scores.spectra - self.spectrum).max(axis=1)
        linear = np.abs(self.correlations(scores)).max(axis=1)
        squared = np.abs((scores.squared - self.squared[0]) / self.squared[1]).max(axis=1)
        return np.stack([ratios, distance, linear, squared], axis=1)


def _moments(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation over draws; a statistic that never varies counts as 0."""
    deviation = values.std(axis=0, ddof=1)
    return values.mean(axis=0), np.where(deviation > 1e-12, deviation, np.inf)
