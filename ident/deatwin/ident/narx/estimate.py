"""Estimators of the parameters of given regressors, which are called with these, and the end of a nonlinear search.

>>> import numpy as np
>>> rows = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 3.0]])
>>> TotalLeastSquares()(rows, np.array([1.0, 3.0, 5.0, 7.0])).theta.round(12).tolist()
[1.0, 2.0]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, inf, lgamma, log, pi
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from deatwin.ident.arguments import positive
from deatwin.ident.narx.bayes import Posterior, Priors, Statistics, posterior
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, nearest

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
        """Return the estimate for `rows` (n_terms, n) and `target` (n,); ``theta_cov`` is ``s^2 (P'P)^-1``."""
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


_OFFSET = 0.05  # Distance from the linearised minimum, in standard deviations, that counts as none
_EXACT = 1e-9  # Share of the outputs below which errors are rounding and have no gradient
_NULL = 1e-9  # Share of the largest singular value below which a direction moves no output


def converged(slopes: Array, errors: Array, samples: int, size: float) -> bool:
    """Return True if a further Gauss-Newton step is short beside the parameters' deviations.

    The measure is the relative offset of Bates and Watts, Technometrics 23 (1981) 179-183: the root mean square of the
    errors along the tangent plane by that of those across it. `slopes` (n, n_theta) and `errors` (n,) may be the
    triangle of a QR decomposition; `samples` is how many errors there are, and `size` the norm of the outputs.
    """
    norms = np.linalg.norm(slopes, axis=0)
    left, values, _ = np.linalg.svd(slopes / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
    along = left[:, values > _NULL * values[0]].T @ errors
    total, gain, n = float(errors @ errors), float(along @ along), max(along.size, 1)
    return total <= (_EXACT * size) ** 2 or gain * (samples - n) <= _OFFSET**2 * n * (total - gain)


@dataclass(frozen=True, kw_only=True, eq=False)
class BayesianEstimate(Estimate):
    """A posterior with its evidence."""

    log_evidence: float  # ln p(y), the marginal likelihood of the outputs as given, nats
    precision: float


@dataclass(frozen=True)
class Ridge:
    """Estimator of given terms, for `Frols` and `Fixed`: minimises ``mean((y - Z theta)^2) + penalty |theta|^2``.

    y is the output, and the columns of Z are the regressors divided by their root mean squares. If there is a constant
    regressor, it is not penalised, and y and the other regressors are centred before the division.

    For the covariance, the penalty is read as a Gaussian prior of theta. Let n be the number of samples, p the
    effective number of parameters, and ``s^2`` the residual sum of squares divided by n - p. ``theta_cov`` is then the
    posterior covariance ``s^2 (Z'Z + n penalty)^-1``. This includes the squared bias of theta, averaged over the prior.

    Parameters
    ----------
    penalty : float or str
        Penalty, a positive dimensionless number. "gcv" chooses it by generalised cross-validation, "evidence" by the
        largest marginal likelihood.

    References
    ----------
    Golub, Heath, Wahba, "Generalized cross-validation as a method for choosing a good ridge parameter",
    Technometrics 21 (1979) 215-223, doi:10.1080/00401706.1979.10489751.
    """

    penalty: float | str = "gcv"

    def __post_init__(self) -> None:
        known = ("gcv", "evidence")
        if isinstance(self.penalty, str) and self.penalty not in known:
            raise ModelError(
                f"penalty = {self.penalty!r}{nearest(self.penalty, known)}; give a number, or gcv or evidence"
            )
        if not isinstance(self.penalty, str):
            positive(self.penalty, "penalty")

    def __call__(self, rows: Array, target: Array) -> Estimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        centred = Centred.of(rows, target)
        sizes = np.sqrt(np.mean(centred.rows**2, axis=1))
        sizes[sizes == 0] = 1.0
        u, s, vt = np.linalg.svd((centred.rows / sizes[:, None]).T, full_matrices=False)
        spectrum = _Spectrum(s**2 / target.size, u.T @ centred.target, centred.target, centred.freedom)
        penalty = self.penalty
        if isinstance(penalty, str):
            penalty = _least({"gcv": spectrum.gcv, "evidence": spectrum.minus_evidence}[penalty])
        theta = vt.T @ (s / target.size / (spectrum.powers + penalty) * spectrum.along) / sizes
        freedom = spectrum.freedom(penalty)
        if not freedom > 0:
            raise ModelError(f"{target.size} samples leave no freedom for noise at penalty = {penalty:g}; take more")
        variance = spectrum.residual(penalty) / freedom
        # Directions that the samples do not show keep their prior variance.
        unseen = np.linalg.qr(vt.T, mode="complete")[0][:, s.size :]
        root = np.hstack([vt.T / np.sqrt(spectrum.powers + penalty), unseen / np.sqrt(penalty)])
        return centred.complete(theta, np.sqrt(variance / target.size) * root / sizes[:, None], variance)


@dataclass(frozen=True)
class Bayesian:
    """Estimator of given terms, for `Frols` and `Fixed`: Bayesian linear regression with a normal-gamma posterior.

    The priors are ``theta | tau ~ N(0, 1/(tau alpha))`` and ``tau ~ Gam(a0, b0)``, where theta are the parameters and
    tau is the noise precision. All parameters share the precision alpha, after each regressor is divided by the power
    of two nearest to its root mean square.

    Parameters
    ----------
    precision : float or None
        Precision alpha, dimensionless; if None, the value with the largest marginal likelihood is used.
    priors : Priors
        Parameters of the priors; only a0 and b0, the shape and rate for the noise precision, are used.

    References
    ----------
    Bishop, "Pattern Recognition and Machine Learning" (2006), sections 3.3 to 3.5.
    """

    precision: float | None = None
    priors: Priors = field(default_factory=Priors)

    def __post_init__(self) -> None:
        if self.precision is not None:
            positive(self.precision, "precision")
        if not isinstance(self.priors, Priors):
            raise ModelError(f"priors = {self.priors!r}; give Priors(), as of deatwin.ident.narx.bayes")

    def __call__(self, rows: Array, target: Array) -> BayesianEstimate:
        """Estimate. Shapes: `rows` (n_terms, n_samples); `target` (n_samples,)."""
        given = Statistics(
            gram=rows @ rows.T, moment=rows @ target, power=float(target @ target), n_samples=target.size
        )
        sizes = given.sizes
        data = given.divided(sizes)

        def at(precision: float) -> tuple[Posterior, float]:
            alpha = np.full(sizes.size, precision)
            found = posterior(data, alpha, self.priors)
            return found, _log_evidence(found, alpha, self.priors)

        precision = self.precision or _least(lambda value: -at(value)[1])
        found, evidence = at(precision)
        return BayesianEstimate(
            theta=found.mean / sizes,
            theta_cov=found.covariance / np.outer(sizes, sizes),
            noise_variance=found.noise_variance,
            dof=2 * found.a,
            log_evidence=evidence,
            precision=precision,
        )


def _log_evidence(found: Posterior, alpha: Array, priors: Priors) -> float:
    """Return ln p(y) at given precisions: the ratio of the normal-gamma law's normalising constants."""
    a0, b0 = priors.a0, priors.b0
    half_n = found.a - a0
    return float(
        -half_n * log(2 * pi)
        + 0.5 * (np.log(alpha).sum() + found.log_det)
        + a0 * log(b0)
        - found.a * log(found.b)
        + lgamma(found.a)
        - lgamma(a0)
    )


class _Spectrum:
    """Quantities of ridge regression from the singular value decomposition, as functions of the penalty."""

    def __init__(self, powers: Array, along: Array, target: Array, samples: int) -> None:
        self.powers, self.along, self.samples = powers, along, samples
        # At least rounding level, so that noise-free data have a logarithm.
        floor = float(np.finfo(float).eps ** 2 * (target @ target))
        self.outside = max(float(target @ target - along @ along), floor)

    def shrunk(self, penalty: float) -> Array:
        """Return the share of each direction that is kept."""
        return np.asarray(self.powers / (self.powers + penalty), dtype=np.float64)

    def freedom(self, penalty: float) -> float:
        """Return the number of samples minus the effective number of parameters."""
        return float(self.samples - self.shrunk(penalty).sum())

    def residual(self, penalty: float) -> float:
        """Return the residual sum of squares."""
        return self.outside + float(np.sum(((1 - self.shrunk(penalty)) * self.along) ** 2))

    def gcv(self, penalty: float) -> float:
        """Return ln of the generalised cross-validation score."""
        return log(self.residual(penalty)) - 2 * log(self.freedom(penalty))

    def minus_evidence(self, penalty: float) -> float:
        """Return -2 ln p(y) at the best noise variance, up to a constant."""
        left = 1 - self.shrunk(penalty)
        square = self.outside + float(np.sum(left * self.along**2))
        return self.samples * log(square) - float(np.log(left).sum())


def _least(measure: Callable[[float], float]) -> float:
    """Return the argument, within 1e-12 to 1e6, at which a measure is least: a grid, then Brent's method."""
    from scipy.optimize import minimize_scalar

    grid = np.linspace(log(1e-12), log(1e6), 90)
    best = int(np.argmin([measure(exp(value)) for value in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(lambda value: measure(exp(value)), bounds=(low, high), method="bounded")
    return exp(float(found.x))
