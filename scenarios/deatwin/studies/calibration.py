"""Test whether stated probabilities agree with observed rates, and compute intervals of medians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.studies.rates import LEVEL, Rate

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
