r"""Parts of the likelihood: a process, the scales of a reading, a reading with its columns, their prior.

.. math:: \mathrm{cov}\,g(t, t') = \kappa^2 \sum_i w_i \exp(-|t - t'| / \tau_i)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from deatwin.plant.errors import DataError


@dataclass(frozen=True, kw_only=True)
class Process:
    """A stationary sum of independent first-order processes, given by shares of the variance and time constants in s."""

    weights: tuple[float, ...]
    times: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.times):
            raise DataError(f"{len(self.weights)} weights for {len(self.times)} time constants of a process")
        if min(self.weights) <= 0.0 or min(self.times) <= 0.0:
            raise DataError("weights and time constants of a process must be positive")

    @property
    def variance(self) -> float:
        """Return the variance of the process if its scale κ is 1."""
        return sum(self.weights)


@dataclass(frozen=True, kw_only=True)
class LogNormal:
    """A positive scale with a log-normal prior; it is known exactly if the spread is 0."""

    median: float
    spread: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.median < np.inf and 0.0 <= self.spread < np.inf):
            raise DataError(f"a scale of median {self.median} and spread {self.spread}: positive numbers are needed")

    def log_density(self, log_value: np.ndarray) -> np.ndarray:
        """Return the log density of the logarithm of the scale; 0 if the scale is known."""
        if self.spread == 0.0:
            return np.zeros_like(log_value)
        z = (log_value - np.log(self.median)) / self.spread
        return -0.5 * z**2 - np.log(self.spread * np.sqrt(2.0 * np.pi))


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """Residual of one reading, with the columns and priors that the likelihood needs.

    `times` (n,) are in s; `records` (n,) numbers the recordings, each of which starts from the stationary process;
    `residual` (n,) is measured minus fitted; `columns` (n, m) the derivative by each coordinate. All SI.
    """

    times: np.ndarray
    records: np.ndarray
    residual: np.ndarray
    columns: np.ndarray
    process: Process
    kappa: LogNormal
    sigma: LogNormal

    def __post_init__(self) -> None:
        n = self.times.size
        if not n or self.records.shape != (n,) or self.residual.shape != (n,) or self.columns.shape[:1] != (n,):
            raise DataError("times, records, residual and columns of a reading must be of the same length")
        if not (np.isfinite(self.residual).all() and np.isfinite(self.columns).all()):
            raise DataError("a reading whose residual or columns are not all finite cannot be judged")
        within = self.records[1:] == self.records[:-1]
        if (np.diff(self.times)[within] <= 0.0).any():
            raise DataError("the times of a recording must rise")

    @property
    def rows(self) -> np.ndarray:
        """Residual and columns as rows, shape (m + 1, n)."""
        return np.ascontiguousarray(np.column_stack([self.residual, self.columns]).T)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """Prior of the coordinates, (m,): standard normal, with lower bounds."""

    fitted: np.ndarray  # coordinates of the fit
    # lower bounds: 0 for an amplitude that cannot be negative, whose prior is half a normal law; else -inf
    above: np.ndarray

    @classmethod
    def of(cls, *blocks: tuple[int, np.ndarray | None], one_sided: Sequence[int] = ()) -> Self:
        """Join blocks of coordinates, at fitted values or else at 0; those in `one_sided` cannot be negative."""
        fitted = np.concatenate([np.zeros(m) if at is None else at for m, at in blocks])
        above = np.full(fitted.size, -np.inf)
        above[list(one_sided)] = 0.0
        return cls(fitted=fitted, above=above)
