"""Estimators of the parameters of given regressors, which are called with these: least squares, total least squares.

>>> import numpy as np
>>> rows = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 3.0]])
>>> TotalLeastSquares()(rows, np.array([1.0, 3.0, 5.0, 7.0])).theta.round(12).tolist()
[1.0, 2.0]
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_DEPENDENT = 1e-14  # sine of the angle between a regressor and earlier ones that rounding alone can produce


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters of a linear regression and their uncertainty."""

    theta: Array  # shape (n_terms,): Parameters
    theta_cov: Array  # shape (n_terms, n_terms): Covariance of the parameters
    noise_variance: float  # Variance of the residual
    dof: float = inf  # Degrees of freedom of theta's Student-t law with that covariance; infinite for a normal law


class Estimator(Protocol):
    """Estimator of the parameters of given regressors."""

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""


def require_estimator(given: object) -> None:
    """Raise ModelError unless `given` can be called like an estimator; a class is no estimator before it is called."""
    if isinstance(given, type) or not callable(given):
        shown = given.__name__ if isinstance(given, type) else repr(given)
        raise ModelError(f"estimator = {shown}; give an object, as Ridge()")


@dataclass(frozen=True)
class LeastSquares:
    """Least-squares estimator of the parameters of given terms, by QR decomposition. For `Frols` and `Fixed`.

    The model's ``theta_dof`` is infinite: intervals and bands treat the residual variance as known. With few samples
    they are therefore too narrow. If there are 10, 30 or 100 more samples than parameters, 95 % intervals contain the
    true value in 92.2, 94.1 or 94.7 % of cases. `Bayesian` and `SvbNarx` give wider intervals, by a Student-t
    distribution.
    """

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Return the estimate for the regressors `rows` (n_terms, n_samples) and the output `target` (n_samples,).

        ``theta_cov`` is ``s^2 (P'P)^-1``, with the residual variance s^2 and the regressors P as columns.
        """
        n_terms, n = rows.shape
        if n <= n_terms:
            raise ModelError(f"{n} samples do not determine {n_terms} parameters and the noise")
        norms = np.linalg.norm(rows, axis=1)
        sizes = np.exp2(np.round(np.log2(np.where(norms > 0, norms, 1.0))))  # powers of two: division does not round
        q, r = np.linalg.qr((rows / sizes[:, None]).T)
        if np.abs(np.diag(r)).min() < _DEPENDENT:
            raise ModelError("the regressors depend on each other on these samples: leave some out, or take Ridge()")
        theta = solve_triangular(r, q.T @ target) / sizes
        theta += solve_triangular(r, q.T @ (target - theta @ rows)) / sizes  # one step of iterative refinement
        residual = target - theta @ rows
        variance = float(residual @ residual) / (n - n_terms)
        root = solve_triangular(r, np.eye(n_terms)) / sizes[:, None]
        return Estimate(theta=theta, theta_cov=variance * (root @ root.T), noise_variance=variance)


least_squares = LeastSquares()  # Least squares, ready to be called


@dataclass(frozen=True, eq=False)
class Centred:
    """A regression without its constant regressor, whose parameter follows from the others."""

    rows: Array  # shape (n_others, n_samples): Other regressors without their means, if there is a constant
    target: Array  # shape (n_samples,): Output without its mean, if there is a constant
    constant: int | None  # Position of the constant regressor
    level: float  # Value of the constant regressor
    means: Array  # shape (n_others,): Means of the other regressors
    mean: float  # Mean of the output

    @classmethod
    def of(cls, rows: Array, target: Array) -> Centred:
        """Remove the constant, if there is one. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        constants = np.flatnonzero((np.ptp(rows, axis=1) == 0) & (rows[:, 0] != 0))
        if constants.size == 0:
            return cls(rows, target, None, 1.0, np.zeros(len(rows)), 0.0)
        first = int(constants[0])
        others = np.delete(rows, first, axis=0)
        means, mean = others.mean(axis=1), float(target.mean())
        return cls(others - means[:, None], target - mean, first, float(rows[first, 0]), means, mean)

    @property
    def freedom(self) -> int:
        """Number of samples minus one for the constant, if there is one."""
        return self.target.size - (self.constant is not None)

    def complete(self, theta: Array, root: Array, variance: float) -> Estimate:
        """Add the constant, mean(y) - mean(P) theta. Shapes: `theta` (n_others,); `root` (n_others, n_others)."""
        if self.constant is None:
            return Estimate(theta=theta, theta_cov=root @ root.T, noise_variance=variance)
        slopes = np.vstack([-self.means / self.level, np.eye(theta.size)])
        full_root = slopes @ root
        full_cov = full_root @ full_root.T
        full_cov[0, 0] += variance / (self.target.size * self.level**2)
        full = np.concatenate([[(self.mean - self.means @ theta) / self.level], theta])
        order = np.insert(np.arange(1, full.size), self.constant, 0)
        return Estimate(theta=full[order], theta_cov=full_cov[np.ix_(order, order)], noise_variance=variance)


@dataclass(frozen=True)
class TotalLeastSquares:
    """Total-least-squares estimator of the parameters of given terms, for errors in the regressors and in the output.

    All errors are assumed to be independent and to have the same variance s^2; a constant regressor has no error. The
    estimate theta satisfies ``P theta = y`` after the smallest change of the regressors P and the output y. It follows
    from the singular value decomposition of [P y]. ``noise_variance`` is ``(1 + |theta|^2) s^2``, the variance of
    ``y - P theta``. For n samples, ``theta_cov`` is the first-order approximation
    ``(1 + |theta|^2) s^2 (P'P - n s^2)^-1``.

    For a NARX model, the assumption holds only roughly: its regressors share lagged signals, and products of signals
    scale the errors. Identifiers such as `Frols` also divide each signal by the power of two above its largest
    magnitude, so the errors are assumed to be equal after this division. If the errors are equal in physical units,
    call the estimator with unscaled regressors, as returned by `TermTable.rows`.

    References
    ----------
    Golub, Van Loan, "An analysis of the total least squares problem", SIAM J. Numer. Anal. 17 (1980) 883-893,
    doi:10.1137/0717073.
    Van Huffel, Vandewalle, "The Total Least Squares Problem" (1991), doi:10.1137/1.9781611971002.
    """

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Return the estimate for the regressors `rows` (n_terms, n_samples) and the output `target` (n_samples,)."""
        centred = Centred.of(rows, target)
        n_terms, n = centred.rows.shape
        if centred.freedom <= n_terms:
            raise ModelError(f"{n} samples do not determine {n_terms} parameters and the noise")
        _, s, vt = np.linalg.svd(np.vstack([centred.rows, centred.target]).T, full_matrices=False)
        if abs(vt[-1, -1]) < np.finfo(float).eps * n:
            raise ModelError("the total least squares problem has no solution: the regressors depend on each other")
        theta = -vt[-1, :-1] / vt[-1, -1]
        variance = float((1 + theta @ theta) * s[-1] ** 2 / (centred.freedom - n_terms))
        # P'P - s_min^2 from the singular values of P, which are not below s_min.
        _, t, wt = np.linalg.svd(centred.rows.T, full_matrices=False)
        root = wt.T / np.sqrt(np.maximum(t**2 - s[-1] ** 2, np.finfo(float).tiny))
        return centred.complete(theta, np.sqrt(variance) * root, variance)
