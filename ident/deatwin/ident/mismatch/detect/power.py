"""Smallest detectable effects, from the statistics of drawn residuals to which an effect is added."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.detect.law import Law
from deatwin.ident.mismatch.thresholds import NEARLY_ALL

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
