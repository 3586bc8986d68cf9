"""Estimate the covariance of parameters from residuals that are neither white nor of constant size.

Where terms leave out physics, parameters scatter more than least squares says (White, Econometrica 50 (1982) 1-25). So
blocks longer than what a record remembers are left out in turn (jackknife: Künsch, Ann. Stat. 17 (1989) 1217-1241); their
slowest cosines say whether parameters drift (Lazarus, Lewis, Stock, Watson, J. Bus. Econ. Stat. 36 (2018) 541-559).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from deatwin.ident.arguments import read_only, whole_number
from deatwin.ident.narx.drive import require_suits
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.regression import Recordings, Regression
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

BLOCKS = 64  # Blocks into which a record is cut: those of a record of five minutes are five seconds long
_ALONE = 1e-9  # least share of the information on a parameter that must remain without a block
_FEWEST = 8  # least number of cosines for the scatter


@dataclass(frozen=True, kw_only=True, eq=False)
class Cosines:
    """Cosine coefficients of short series, uncorrelated if the series are: the covariance of mean and drift."""

    coefficients: Array
    n_slow: int  # Number of first coefficients, which belong to a drift and do not count as scatter

    @classmethod
    def of(cls, series: ArrayLike, n_slow: int = 0) -> Cosines:
        """Transform series. Shapes: `series` (n, n_series)."""
        values = np.asarray(series, dtype=np.float64)
        n = len(values)
        if n_slow < 0 or n - 1 - n_slow < _FEWEST:
            raise ModelError(
                f"{n} values with {n_slow} cosines of a drift; at least {_FEWEST + 1 + max(n_slow, 0)} are needed"
            )
        shapes = _shapes(np.arange(1, n), (np.arange(n) + 0.5) / n, n)
        return cls(coefficients=read_only(shapes @ values), n_slow=n_slow)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the scatter."""
        return len(self.coefficients) - self.n_slow

    @property
    def slow(self) -> Array:
        """Coefficients of the drift, shape (n_slow, n_series)."""
        return self.coefficients[: self.n_slow]

    @property
    def fast(self) -> Array:
        """Coefficients of the scatter, shape (dof, n_series)."""
        return self.coefficients[self.n_slow :]

    @property
    def scale(self) -> Array:
        """Squared scale of the t law of the means, shape (n_series, n_series)."""
        return np.asarray(self.fast.T @ self.fast / (self.dof * self._count), dtype=np.float64)

    def projected(self, directions: ArrayLike) -> Cosines:
        """Return the cosines of linear combinations of the series. Shapes: `directions` (n_combinations, n_series)."""
        return replace(self, coefficients=read_only(self.coefficients @ np.asarray(directions, dtype=np.float64).T))

    def drift(self, shares: ArrayLike) -> Array:
        """Return the drift of the series by the slow cosines, (n_times, n_series); `shares` (n_times,)."""
        return np.asarray(self._slow_shapes(shares).T @ self.slow, dtype=np.float64)

    def drift_scales(self, shares: ArrayLike) -> Array:
        """Squared scales of mean plus drift, (n_times, n_series, n_series); `shares` (n_times,)."""
        larger = 1 + self._count * (self._slow_shapes(shares) ** 2).sum(axis=0)
        return np.asarray(larger[:, None, None] * self.scale, dtype=np.float64)

    @property
    def _count(self) -> int:
        return len(self.coefficients) + 1

    def _slow_shapes(self, shares: ArrayLike) -> Array:
        return _shapes(np.arange(1, self.n_slow + 1), np.asarray(shares, dtype=np.float64), self._count)


def _shapes(half_periods: NDArray[np.int_], shares: Array, n: int) -> Array:
    """Cosines of unit norm over n values, shape (n_cosines, n_times)."""
    return np.asarray(np.sqrt(2 / n) * np.cos(np.pi * np.outer(half_periods, shares)), dtype=np.float64)


def pseudovalues(
    model: NarxModel, recordings: Recordings, *, n_blocks: int = BLOCKS, instruments: Recordings | None = None
) -> Array:
    """Return the jackknife's deviation of the parameters by block, (n_blocks, n_terms); `instruments` give Z."""
    require_model(model)
    model.require_one_output("the jackknife")
    whole_number(n_blocks, "n_blocks", 2)
    data = Regression.on(recordings, model.table).about(model)
    for record in data.recordings:
        require_suits(record, model, with_outputs=True, fewest=0)
    rows, target = data.matrix()
    others = rows if instruments is None else Regression.on(instruments, model.table).about(model).matrix()[0]
    if others.shape != rows.shape:
        raise ModelError(f"the recordings have {rows.shape[1]} usable samples, the instruments {others.shape[1]}")
    n_terms, n = rows.shape
    if n < 2 * n_blocks or n <= n_terms:
        raise ModelError(f"{n} samples are too few for {n_blocks} blocks and {n_terms} parameters")
    residual = target - (model.theta / data.term_scales) @ rows
    # Orthonormal regressors, so that no digits are lost to a Gram matrix.
    (q, r), z = np.linalg.qr(rows.T), np.linalg.qr(others.T)[0]
    found = np.empty((n_blocks, n_terms))
    edges = np.linspace(0, n, n_blocks + 1).round().astype(int)
    for k, block in enumerate(map(slice, edges[:-1], edges[1:])):
        remaining = z.T @ q - z[block].T @ q[block]
        if np.linalg.svd(remaining, compute_uv=False)[-1] < _ALONE:
            raise ModelError(
                f"without samples {edges[k]} to {edges[k + 1]} the parameters are not determined: leave terms out"
            )
        found[k] = np.linalg.solve(remaining, z[block].T @ residual[block])
    return np.asarray((n_blocks - 1) * solve_triangular(r, found.T).T * data.term_scales, dtype=np.float64)


def robust(model: NarxModel, recordings: Recordings, *, n_blocks: int = BLOCKS) -> NarxModel:
    """Return the model with a parameter covariance that does not require white residuals (block jackknife).

    The covariance is valid even if the terms cannot describe the plant. It then describes how the parameters scatter
    between recordings of similar excitation. Parameters from recordings of different excitation differ by more than
    this scatter, because the error due to missing terms depends on the excitation.

    Parameters
    ----------
    model : NarxModel
        Model with one output and no noise terms, fitted by least squares to ``recordings``.
    recordings : Recording, Experiment, or several
        Recordings to which the model was fitted.
    n_blocks : int
        Number of blocks into which the samples are cut, at least 9. Each block should be longer than the plant's
        response time.

    Returns
    -------
    NarxModel
        Model with the new ``theta_cov``; ``theta_dof``, the degrees of freedom of the t distribution, is
        ``n_blocks - 1``. The rank of the covariance is at most ``n_blocks - 1``, so use the covariance only for a few
        combinations of the parameters at a time.

    Raises
    ------
    ModelError
        If the model has several outputs or noise terms, the recordings do not suit the model, ``n_blocks`` is below 9,
        there are too few samples, or the parameters are not determined without one of the blocks.
    """
    cosines = Cosines.of(pseudovalues(model, recordings, n_blocks=n_blocks))
    return replace(model, theta_cov=cosines.scale * cosines.dof / (cosines.dof - 2), theta_dof=float(cosines.dof))
