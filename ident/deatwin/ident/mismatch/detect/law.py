"""Distribution of the statistics of a residual under chance."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.detect.null import Refit, null_residuals
from deatwin.ident.mismatch.detect.statistics import Battery, Scores
from deatwin.ident.mismatch.thresholds import NEARLY_ALL, SIGNIFICANCE

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


FACTOR, STEPS, HALVINGS = 1.5, 40, 6


class Power:
    """Detection of an effect by its size and its correlations on the fitted data; held-out data can only add to it."""

    def __init__(self, law: Law) -> None:
        self._law = law
        fitted = law.left.fitted
        self._share = float(fitted.mean())
        self._inside = law.kept[:, fitted]
        self._square = np.mean(self._inside**2, axis=1)
        self._outside = np.mean(law.kept**2, axis=1) - self._share * self._square
        self._along = law.kept @ law.battery.regressors

    def smallest(self, change: np.ndarray, practical: float) -> float | None:
        """Return the strength at which an effect is detected nine times in ten; None if the refit absorbs all of it.

        `change`, (m,), is the change of the fitted part's residual for unit strength, after the refit; `practical` the
        smallest rms that counts; both in SI.
        """
        power = float(np.mean(change**2))
        if power == 0.0:
            return None
        cross = self._inside @ change / change.size
        along = self._law.battery.regressors[self._law.left.fitted].T @ change

        def caught(strength: float) -> bool:
            square = self._square + 2 * strength * cross + strength**2 * power
            return float(np.mean(self._detected(square, self._along + strength * along, practical))) >= NEARLY_ALL

        lowest = 0.1 * self._law.left.noise / np.sqrt(power)
        high = next((lowest * FACTOR**k for k in range(STEPS) if caught(lowest * FACTOR**k)), None)
        if high is None:
            return None
        low = high / FACTOR
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if caught(middle) else (middle, high)
        return float(high)

    def _detected(self, square: np.ndarray, along: np.ndarray, practical: float) -> np.ndarray:
        """Return whether each draw is detected, from its mean squares and its amplitudes along the regressors in fitted
        data.
        """
        law = self._law
        linear = along / np.sqrt(self._share * square + self._outside)[:, None]
        ratio = (np.log(square / law.left.floor) - law.ratios[0][0]) / law.ratios[1][0]
        largest = np.abs((linear - law.linear[0]) / law.linear[1]).max(axis=1)
        scores = (np.stack([ratio, largest], axis=1) - law.moments[0, [0, 2]]) / law.moments[1, [0, 2]]
        size = np.sqrt(np.maximum(square - law.left.noise**2, 0.0))
        return np.asarray((scores.max(axis=1) >= law.critical) & (size >= practical))
