"""Variational Bayesian linear regression with automatic relevance determination (Drugowitsch, arXiv:1310.5438)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack
from scipy.special import gammaln

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

# E[alpha] from which the first update is least squares, for regressors of root mean square 1: a large value would first
# have to leave the state without any term. It also exceeds the rounding error of singular statistics, whose Cholesky
# factor therefore exists.
FLAT = 1e-6
_LEAF = 64  # most rows of a triangle that LAPACK inverts as fast as products of blocks do


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Gamma priors: tau ~ Gam(a0, b0) of the noise precision, alpha_m ~ Gam(c0, d0) of each relevance."""

    a0: float = 1e-2  # Shape of the prior of the noise precision
    b0: float = 1e-4  # Rate of that prior
    c0: float = 1e-2  # Shape of the prior of each term's precision, relative to that of the noise
    d0: float = 1e-4  # Rate of that prior


@dataclass(frozen=True, kw_only=True, eq=False)
class Statistics:
    """Sufficient statistics of a linear regression."""

    gram: Array  # shape (n_terms, n_terms): Phi'Phi
    moment: Array  # shape (n_terms,): Phi'y
    power: float  # y'y
    n_samples: int  # Number of samples

    def only(self, keep: NDArray[np.intp]) -> Statistics:
        """Return the statistics of selected terms."""
        return replace(self, gram=self.gram[np.ix_(keep, keep)], moment=self.moment[keep])

    @property
    def sizes(self) -> Array:
        """Root mean square of each regressor, rounded to a power of two; 1 for a zero regressor; shape (n_terms,)."""
        return np.exp2(np.round(np.log2(self.root_mean_squares)))

    @property
    def root_mean_squares(self) -> Array:
        """Root mean square of each regressor, 1 for a zero regressor; shape (n_terms,)."""
        squares = np.diag(self.gram) / self.n_samples
        return np.sqrt(np.where(squares > 0, squares, 1.0))

    @property
    def output_size(self) -> float:
        """Root mean square of the output, 1 for a zero output."""
        return sqrt(self.power / self.n_samples) or 1.0

    def divided(self, sizes: Array, output_size: float = 1.0) -> Statistics:
        """Return the statistics of regressors and output divided by sizes. Shapes: `sizes` (n_terms,)."""
        gram, moment = self.gram / np.outer(sizes, sizes), self.moment / sizes / output_size
        return replace(self, gram=gram, moment=moment, power=self.power / output_size**2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """q(theta, tau) = N(theta | mean, V / tau) Gam(tau | a, b); theta is Student-t, 2a degrees of freedom."""

    mean: Array  # shape (n_terms,): Mean of theta
    root: Array  # shape (n_terms, n_terms): Lower triangular W with V = W'W
    a: float  # Shape of the posterior of the noise precision
    b: float  # Rate of that posterior
    residual: float  # Sum of squares ||y - Phi mean||^2

    @property
    def spread(self) -> Array:
        """Diagonal of V, shape (n_terms,)."""
        return np.asarray(np.einsum("ij,ij->j", self.root, self.root), dtype=np.float64)

    @property
    def log_det(self) -> float:
        """ln |V|."""
        return 2 * float(np.log(np.diag(self.root)).sum())

    @property
    def covariance(self) -> Array:
        """Covariance of theta: the squared scale of the Student-t law, V b/a, times 2a / (2a - 2)."""
        return np.asarray(self.root.T @ self.root * self.noise_variance, dtype=np.float64)

    @property
    def noise_variance(self) -> float:
        """Posterior mean of 1/tau."""
        return self.b / (self.a - 1)


def posterior(data: Statistics, alpha: Array, priors: Priors) -> Posterior:
    """Return the posterior for fixed relevances, which is exactly normal-gamma. Shapes: `alpha` (n_terms,)."""
    precision = np.array(data.gram.T, order="F")  # symmetric, so that the transpose copies along memory
    precision[np.diag_indices(alpha.size)] += alpha
    root, info = lapack.dpotrf(precision, lower=1, overwrite_a=1)
    if info != 0:
        raise ModelError(
            "the candidate terms are numerically dependent on these recordings; use fewer lags or a lower degree"
        )
    invert_triangle(root)
    mean = root.T @ (root @ data.moment)
    residual = max(data.power - 2 * float(mean @ data.moment) + float(mean @ data.gram @ mean), 0.0)
    return Posterior(
        mean=mean,
        root=root,
        a=priors.a0 + data.n_samples / 2,
        b=priors.b0 + (residual + float(alpha @ mean**2)) / 2,
        residual=residual,
    )


def invert_triangle(lower: Array) -> None:
    """Replace a lower triangular matrix (n, n) by its inverse, block by block: twice as fast as LAPACK's dtrtri."""
    n = len(lower)
    if n <= _LEAF:
        lower[:] = lapack.dtrtri(lower, lower=1)[0]
        return
    first, below, last = lower[: n // 2, : n // 2], lower[n // 2 :, : n // 2], lower[n // 2 :, n // 2 :]
    invert_triangle(first)
    invert_triangle(last)
    between = blas.dtrmm(-1.0, first, below, side=1, lower=1)
    below[:] = blas.dtrmm(1.0, last, between, lower=1, overwrite_b=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class RelevanceFit:
    """Converged variational posterior of one set of terms."""

    posterior: Posterior
    alpha: Array  # shape (n_terms,): E[alpha]; its inverse is the relevance of a term
    bounds: tuple[float, ...]  # Lower bound on ln p(y) after each update; it never falls
    settled: bool  # True if parameters and noise had converged at the end


def fit_relevance(
    data: Statistics, priors: Priors, alpha: Array, *, tolerance: float, max_iterations: int
) -> RelevanceFit:
    """Iterate q(theta, tau) and q(alpha), from `alpha` (n_terms,), until parameters and noise converge. The bound is no
    criterion: for nearly collinear terms it rises by a millionth per update, and by hundreds of nats in all."""
    shape = priors.c0 + 0.5
    bounds: list[float] = []
    before: Posterior | None = None
    for _ in range(max_iterations):
        current = posterior(data, alpha, priors)
        spread = current.spread
        rate = priors.d0 + 0.5 * (current.a / current.b * current.mean**2 + spread)
        # tr(Phi'Phi V) = tr((V^-1 - A) V), so that no product of matrices is needed.
        trace = alpha.size - float(alpha @ spread)
        bounds.append(_lower_bound(data.n_samples, current, rate, trace, priors))
        settled = before is not None and _settled(data, alpha, before, current, tolerance)
        alpha, before = shape / rate, current
        if settled:
            break
    return RelevanceFit(posterior=current, alpha=alpha, bounds=tuple(bounds), settled=settled)


def _settled(data: Statistics, alpha: Array, before: Posterior, now: Posterior, tolerance: float) -> bool:
    """Return whether the update to relevances alpha moved parameters and noise by less than the tolerance."""
    moved = now.mean - before.mean
    distance = now.a / now.b * float(moved @ data.gram @ moved + alpha @ moved**2)  # squared, in deviations
    return distance <= tolerance**2 * moved.size and abs(now.b - before.b) <= tolerance * now.b


def _lower_bound(n: int, q: Posterior, rate: Array, trace: float, priors: Priors) -> float:
    """Return the bound (arXiv:1310.5438); q must come from the E[alpha] before ``rate`` was updated."""
    a0, b0, c0, d0 = priors.a0, priors.b0, priors.c0, priors.d0
    shape = c0 + 0.5
    likelihood = -0.5 * n * log(2 * pi) - 0.5 * (q.a / q.b * q.residual + trace)
    parameters = 0.5 * (q.log_det + rate.size)
    noise = -gammaln(a0) + a0 * log(b0) - b0 * q.a / q.b + gammaln(q.a) - q.a * log(q.b) + q.a
    relevance = rate.size * (-gammaln(c0) + c0 * log(d0) + gammaln(shape)) - shape * float(np.log(rate).sum())
    return float(likelihood + parameters + noise + relevance)
