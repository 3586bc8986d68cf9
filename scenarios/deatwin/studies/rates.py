"""Rates of events, with exact bounds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import floor
from typing import Literal

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
