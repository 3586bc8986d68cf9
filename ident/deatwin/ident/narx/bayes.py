"""Variational Bayesian linear regression with automatic relevance determination.

The updates and the lower bound are those of Drugowitsch, arXiv:1310.5438, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack
from scipy.special import gammaln

from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]

_LEAF = 64  # rows up to which LAPACK inverts a triangle as fast as products of blocks do


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Gamma priors: tau ~ Gam(a0, b0) of the noise precision, alpha_m ~ Gam(c0, d0) of each relevance.

    Parameters
    ----------
    a0, b0 : float
        Shape and rate of the noise precision.
    c0, d0 : float
        Shape and rate of each term's precision, relative to that of the noise.
    """

    a0: float = 1e-2
    b0: float = 1e-4
    c0: float = 1e-2
    d0: float = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class Statistics:
    """What the data say: sufficient statistics of the regression.

    Parameters
    ----------
    gram : ndarray, shape (n_terms, n_terms)
        Phi'Phi.
    moment : ndarray, shape (n_terms,)
        Phi'y.
    power : float
        y'y.
    n_samples : int
        Number of samples.
    """

    gram: Array
    moment: Array
    power: float
    n_samples: int

    def only(self, keep: NDArray[np.intp]) -> Statistics:
        """Return the statistics of some of the terms.

        Parameters
        ----------
        keep : ndarray of int
            Their positions.
        """
        return Statistics(
            gram=self.gram[np.ix_(keep, keep)],
            moment=self.moment[keep],
            power=self.power,
            n_samples=self.n_samples,
        )

    @property
    def sizes(self) -> Array:
        """Root mean square of each regressor as a power of two, 1 for a zero one; shape (n_terms,)."""
        squares = np.diag(self.gram) / self.n_samples
        return np.exp2(np.round(0.5 * np.log2(np.where(squares > 0, squares, 1.0))))

    def divided(self, sizes: Array) -> Statistics:
        """Return the statistics of the regressors divided by sizes.

        Parameters
        ----------
        sizes : ndarray, shape (n_terms,)
            A divisor for each.
        """
        return Statistics(
            gram=self.gram / np.outer(sizes, sizes),
            moment=self.moment / sizes,
            power=self.power,
            n_samples=self.n_samples,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """q(theta, tau) = N(theta | mean, V / tau) Gam(tau | a, b); theta is Student-t, 2a degrees of freedom.

    Parameters
    ----------
    mean : ndarray, shape (n_terms,)
        Mean of theta.
    root : ndarray, shape (n_terms, n_terms)
        Lower triangular W with V = W'W.
    a, b : float
        Shape and rate of the noise precision.
    residual : float
        Sum of squares ||y - Phi mean||^2.
    """

    mean: Array
    root: Array
    a: float
    b: float
    residual: float

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
    """Return the posterior at given relevances; exact (normal-gamma) when they are fixed.

    Parameters
    ----------
    data : Statistics
        Of n_terms terms.
    alpha : ndarray, shape (n_terms,)
        Precision of each parameter relative to the noise's, E[alpha].
    priors : Priors
        Of the noise precision.

    Raises
    ------
    ModelError
        If the terms are numerically dependent beyond what the prior can hold.
    """
    precision = np.array(data.gram.T, order="F")  # it is symmetric: the transpose copies along memory
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
    """Replace a lower triangular matrix by its inverse, from products of its blocks.

    As stable as LAPACK's dtrtri and, for hundreds of rows, twice as fast: nearly all work is done by dtrmm.

    Parameters
    ----------
    lower : ndarray, shape (n, n)
        Lower triangular, zero above the diagonal; overwritten.
    """
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
    """Converged variational posterior of one set of terms.

    Parameters
    ----------
    posterior : Posterior
        Of parameters and noise.
    alpha : ndarray, shape (n_terms,)
        E[alpha]; its inverse is the relevance of a term.
    bounds : tuple of float
        Lower bound on ln p(y) after each update; it never falls.
    """

    posterior: Posterior
    alpha: Array
    bounds: tuple[float, ...]


def fit_relevance(
    data: Statistics, priors: Priors, alpha: Array, *, tolerance: float, max_iterations: int
) -> RelevanceFit:
    """Iterate q(theta, tau) and q(alpha) until the lower bound rises no more.

    Parameters
    ----------
    data : Statistics
        Of n_terms terms.
    priors : Priors
        All four.
    alpha : ndarray, shape (n_terms,)
        E[alpha] to start with.
    tolerance : float
        Stop when the bound rises by less than this share of itself.
    max_iterations : int
        Stop after so many updates.

    Returns
    -------
    RelevanceFit
    """
    shape = priors.c0 + 0.5
    bounds: list[float] = []
    for _ in range(max_iterations):
        current = posterior(data, alpha, priors)
        spread = current.spread
        rate = priors.d0 + 0.5 * (current.a / current.b * current.mean**2 + spread)
        # tr(Phi'Phi V) = tr((V^-1 - A) V), so that no product of matrices is needed.
        trace = alpha.size - float(alpha @ spread)
        bounds.append(_lower_bound(data.n_samples, current, rate, trace, priors))
        alpha = shape / rate
        if len(bounds) > 1 and bounds[-1] - bounds[-2] <= tolerance * abs(bounds[-1]):
            break
    return RelevanceFit(posterior=current, alpha=alpha, bounds=tuple(bounds))


def _lower_bound(n: int, q: Posterior, rate: Array, trace: float, priors: Priors) -> float:
    """Return the bound (arXiv:1310.5438); q must come from the E[alpha] before ``rate`` was updated."""
    a0, b0, c0, d0 = priors.a0, priors.b0, priors.c0, priors.d0
    shape = c0 + 0.5
    likelihood = -0.5 * n * log(2 * pi) - 0.5 * (q.a / q.b * q.residual + trace)
    parameters = 0.5 * (q.log_det + rate.size)
    noise = -gammaln(a0) + a0 * log(b0) - b0 * q.a / q.b + gammaln(q.a) - q.a * log(q.b) + q.a
    relevance = rate.size * (-gammaln(c0) + c0 * log(d0) + gammaln(shape)) - shape * float(np.log(rate).sum())
    return float(likelihood + parameters + noise + relevance)
