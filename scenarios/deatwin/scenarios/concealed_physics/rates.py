"""Rates with exact bounds, and how well stated probabilities are borne out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.scenarios.svb_benchmark.trials import LEVEL, Rate

BINS = 10
"""Of stated probabilities, from 0 to 1."""


def most(rate: Rate) -> float:
    """The one-sided upper 95 % bound of a rate.

    Source: Clopper & Pearson, Biometrika 26 (1934) 404.

    Examples
    --------
    >>> round(most(Rate(hits=0, count=150)), 4)
    0.0198
    """
    from scipy.stats import beta

    rest = rate.count - rate.hits
    return float(beta.ppf(LEVEL, rate.hits + 1, rest)) if rest else 1.0


def least(rate: Rate) -> float:
    """The one-sided lower 95 % bound of a rate."""
    return 1.0 - most(Rate(hits=rate.count - rate.hits, count=rate.count))


def bounds(rate: Rate) -> tuple[float, float]:
    """The two-sided 95 % bounds of a rate."""
    return rate.interval if rate.count else (0.0, 1.0)


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """An interval of order statistics that holds the median with at least 95 %."""
    from scipy.stats import binom

    ordered = np.sort(np.asarray(values, dtype=float))
    if not ordered.size:
        return float("nan"), float("nan")
    # The r-th value from either end lies outside the median with the probability of fewer than r successes.
    out = max(int(binom.ppf(0.5 * (1 - LEVEL), ordered.size, 0.5)) - 1, 0)
    return float(ordered[out]), float(ordered[-1 - out])


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """One bin of stated probabilities."""

    stated: float  # Mean of what was stated in it
    came_true: Rate  # How often it was so


def reliability(stated: Sequence[float], true: Sequence[bool]) -> tuple[Calibration, ...]:
    """Sort stated probabilities into bins, and count how often each bin was right."""
    probabilities, happened = np.asarray(stated, dtype=float), np.asarray(true, dtype=bool)
    places = np.minimum((probabilities * BINS).astype(int), BINS - 1)
    return tuple(
        Calibration(stated=float(probabilities[places == k].mean()), came_true=Rate.of(happened[places == k].tolist()))
        for k in range(BINS)
        if (places == k).any()
    )


def expected_calibration_error(bins: Sequence[Calibration]) -> float:
    """Mean distance of what was stated from what came true, by the number in each bin."""
    total = sum(b.came_true.count for b in bins)
    if not total:
        return float("nan")
    return sum(b.came_true.count * abs(b.stated - b.came_true.share) for b in bins) / total


def brier_score(stated: Sequence[float], true: Sequence[bool]) -> float:
    """Mean square of stated probability less outcome.

    Source: Brier, Mon. Weather Rev. 78 (1950) 1.
    """
    if not len(stated):
        return float("nan")
    return float(np.mean((np.asarray(stated, dtype=float) - np.asarray(true, dtype=float)) ** 2))
