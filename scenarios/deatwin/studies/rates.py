"""Rates of events with exact bounds, and how well stated probabilities agree with them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import floor
from typing import Literal

import numpy as np

LEVEL = 0.95  # Confidence of all bounds


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Share of cases in which something happened, with exact bounds (Clopper & Pearson, Biometrika 26 (1934) 404."""

    hits: int
    count: int

    @classmethod
    def of(cls, happened: Iterable[bool]) -> Rate:
        """Count hits and cases."""
        flags = list(happened)
        return cls(hits=sum(map(bool, flags)), count=len(flags))

    @property
    def share(self) -> float:
        """Number of hits divided by the number of cases."""
        return self.hits / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """Two-sided 95 % interval, with at least that coverage; 0 to 1 without a case."""
        return self._bounds("two-sided")

    @property
    def least(self) -> float:
        """The one-sided lower 95 % bound."""
        return self._bounds("greater")[0]

    @property
    def most(self) -> float:
        """The one-sided upper 95 % bound.

        >>> round(Rate(hits=0, count=150).most, 4)
        0.0198
        """
        return self._bounds("less")[1]

    @property
    def least_percent(self) -> int:
        """One-sided lower 95 % bound, rounded down.

        >>> round(100 * Rate(hits=44, count=45).least, 2), Rate(hits=44, count=45).least_percent
        (89.89, 89)
        """
        return floor(100 * self.least)

    def __str__(self) -> str:
        low, high = (100 * end for end in self.interval)
        return f"{100 * self.share:.4g} % ({low:.3g} to {high:.3g})"

    def _bounds(self, side: Literal["two-sided", "less", "greater"]) -> tuple[float, float]:
        from scipy.stats import binomtest

        if not self.count:
            return 0.0, 1.0
        interval = binomtest(self.hits, self.count, alternative=side).proportion_ci(LEVEL, method="exact")
        return float(interval.low), float(interval.high)


BINS = 10  # Bins of stated probabilities, from 0 to 1


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """One bin of stated probabilities."""

    stated: float  # Mean of the probabilities in the bin
    came_true: Rate


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the interval of order statistics that contains the median with a probability of at least 95 %."""
    from scipy.stats import binom

    ordered = np.sort(np.asarray(values, dtype=float))
    if not ordered.size:
        return float("nan"), float("nan")
    # The probability that the r-th value from either end lies beyond the median is that of fewer than r successes.
    out = max(int(binom.ppf(0.5 * (1 - LEVEL), ordered.size, 0.5)) - 1, 0)
    return float(ordered[out]), float(ordered[-1 - out])


def reliability(stated: Sequence[tuple[float, bool]]) -> tuple[Calibration, ...]:
    """Sort stated probabilities into bins, and count the right answers in each."""
    probabilities, happened = np.array(stated, dtype=float).reshape(-1, 2).T
    places = np.minimum((probabilities * BINS).astype(int), BINS - 1)
    return tuple(
        Calibration(stated=float(probabilities[places == k].mean()), came_true=Rate.of(happened[places == k] > 0))
        for k in range(BINS)
        if (places == k).any()
    )


def expected_calibration_error(bins: Sequence[Calibration]) -> float:
    """Return the mean difference of stated probability and observed rate, weighted by the numbers in the bins."""
    total = sum(b.came_true.count for b in bins)
    if not total:
        return float("nan")
    return sum(b.came_true.count * abs(b.stated - b.came_true.share) for b in bins) / total


def brier_score(stated: Sequence[tuple[float, bool]]) -> float:
    """Return the mean squared difference of stated probability and outcome (Brier, Mon. Weather Rev. 78 (1950) 1)."""
    return float(np.mean([(p - happened) ** 2 for p, happened in stated])) if stated else float("nan")
