"""Sparse variational Bayes: NARX structure and parameters by automatic relevance determination and pruning."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_solve, cholesky, lapack
from scipy.special import gammaln

from deatwin.ident.narx.regression import NarxIdentifier, Recordings, Regression
from deatwin.ident.narx.terms import Lags, Term
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]


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
        return Statistics(gram=self.gram[np.ix_(keep, keep)], moment=self.moment[keep], power=self.power,
                          n_samples=self.n_samples)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """q(theta, tau) = N(theta | mean, V / tau) Gam(tau | a, b): theta is Student-t with 2a degrees of freedom.

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
    try:
        lower = cholesky(data.gram + np.diag(alpha), lower=True)
    except LinAlgError as error:
        raise ModelError("the candidate terms are numerically dependent on these recordings; "
                         "use fewer lags or a lower degree") from error
    mean = cho_solve((lower, True), data.moment)
    residual = max(data.power - 2 * float(mean @ data.moment) + float(mean @ data.gram @ mean), 0.0)
    return Posterior(mean=mean, root=lapack.dtrtri(lower, lower=1)[0], a=priors.a0 + data.n_samples / 2,
                     b=priors.b0 + (residual + float(alpha @ mean ** 2)) / 2, residual=residual)


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


def fit_relevance(data: Statistics, priors: Priors, alpha: Array, *, tolerance: float,
                  max_iterations: int) -> RelevanceFit:
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
        rate = priors.d0 + 0.5 * (current.a / current.b * current.mean ** 2 + spread)
        # tr(Phi'Phi V) = tr((V^-1 - A) V), so that no product of matrices is needed.
        trace = alpha.size - float(alpha @ spread)
        bounds.append(_lower_bound(data.n_samples, current, rate, trace, priors))
        alpha = shape / rate
        if len(bounds) > 1 and bounds[-1] - bounds[-2] <= tolerance * abs(bounds[-1]):
            break
    return RelevanceFit(posterior=current, alpha=alpha, bounds=tuple(bounds))


def _lower_bound(n: int, q: Posterior, rate: Array, trace: float, priors: Priors) -> float:
    """Return the variational bound; q must come from the E[alpha] before ``rate`` was updated (arXiv:1310.5438)."""
    a0, b0, c0, d0 = priors.a0, priors.b0, priors.c0, priors.d0
    shape = c0 + 0.5
    likelihood = -0.5 * n * log(2 * pi) - 0.5 * (q.a / q.b * q.residual + trace)
    parameters = 0.5 * (q.log_det + rate.size)
    noise = -gammaln(a0) + a0 * log(b0) - b0 * q.a / q.b + gammaln(q.a) - q.a * log(q.b) + q.a
    relevance = rate.size * (-gammaln(c0) + c0 * log(d0) + gammaln(shape)) - shape * float(np.log(rate).sum())
    return float(likelihood + parameters + noise + relevance)


@dataclass(frozen=True, kw_only=True, eq=False)
class PruningStep:
    """One step of the pruning loop.

    Parameters
    ----------
    terms : tuple of Term
        The terms fitted in this step.
    indices : ndarray of int, shape (n_terms,)
        Their positions among the candidates.
    relevance : ndarray, shape (n_terms,)
        1 / E[alpha] of each, in scaled signals.
    threshold : float
        Terms whose relevance lies below are pruned next.
    bounds : tuple of float
        Lower bound after each update.
    """

    terms: tuple[Term, ...]
    indices: NDArray[np.intp]
    relevance: Array
    threshold: float
    bounds: tuple[float, ...]

    @property
    def lower_bound(self) -> float:
        """Converged lower bound in nats."""
        return self.bounds[-1]


class SvbNarx(NarxIdentifier):
    """Sparse variational Bayesian NARX: relevance determination, pruning, choice by the largest lower bound.

    With ``y | theta, tau ~ N(Phi theta, 1/tau)``, ``theta | tau, alpha ~ N(0, 1/(tau alpha))`` and gamma priors, the
    variational posterior of all candidates is iterated to convergence; the terms with the least relevance
    ``1/E[alpha]`` are pruned, those below ``min + (max - min)/resolution`` on a logarithmic scale; and so on, each
    step starting from the last relevances, down to one term. The step with the largest lower bound is the model
    (all models being equally probable beforehand).

    Parameters
    ----------
    output_lags, input_lags : int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples.
    degree : int
        Largest degree of a candidate.
    resolution : float
        The larger, the fewer terms a step prunes; above 1.
    a0, b0, c0, d0 : float
        Shapes and rates of the gamma priors of noise precision and relevances.
    tolerance : float
        A step has converged when its bound rises by less than this share of itself.
    max_iterations : int
        Largest number of updates in a step.

    Attributes
    ----------
    model_ : NarxModel
        The chosen model, in physical units. The posterior of theta is Student-t with ``theta_dof = 2 a_N`` degrees of
        freedom; ``theta_cov`` is its covariance, ``theta_cov (theta_dof - 2)/theta_dof`` its squared scale.
    terms_ : tuple of Term
        Its terms.
    lower_bound_ : float
        Its lower bound on ln p(y) in nats, for signals scaled as `Regression` tells.
    relevance_ : ndarray, shape (n_terms,)
        1 / E[alpha] of its terms, in scaled signals.
    path_ : tuple of PruningStep
        All steps, from all candidates down to one term.

    References
    ----------
    Jacobs, Baldacchino, Dodd, Anderson, "Sparse Bayesian nonlinear system identification using variational
    inference", IEEE Trans. Autom. Control 63 (2018), doi:10.1109/TAC.2018.2813004.
    Drugowitsch, "Variational Bayesian inference for linear and logistic regression", arXiv:1310.5438.
    """

    def __init__(self, *, output_lags: Lags = 2, input_lags: Lags = 2, degree: int = 2, resolution: float = 100.0,
                 a0: float = 1e-2, b0: float = 1e-4, c0: float = 1e-2, d0: float = 1e-4,
                 tolerance: float = 1e-5, max_iterations: int = 500) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.resolution = resolution
        self.a0 = a0
        self.b0 = b0
        self.c0 = c0
        self.d0 = d0
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def fit(self, recordings: Recordings) -> Self:
        """Choose terms and infer their parameters.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data of one sample time.

        Returns
        -------
        SvbNarx
            The estimator itself.

        Raises
        ------
        ModelError
            If an argument makes no sense, or there are too few samples.
        """
        if self.resolution <= 1 or self.max_iterations < 1 or min(self.a0, self.b0, self.c0, self.d0) <= 0:
            raise ModelError("resolution must be above 1, max_iterations at least 1 and a0, b0, c0, d0 positive")
        data = Regression.of(recordings, output_lags=self.output_lags, input_lags=self.input_lags, degree=self.degree)
        if data.n_samples < 3:
            raise ModelError(f"{data.n_samples} usable samples are too few; at least 3 are needed")
        gram, moment, power = data.gram()
        steps, best = self._prune(
            data, Statistics(gram=gram, moment=moment, power=power, n_samples=data.n_samples))
        self.path_ = tuple(steps)
        chosen = max(steps, key=lambda step: step.lower_bound)
        self.lower_bound_ = chosen.lower_bound
        self.relevance_ = chosen.relevance
        self.model_ = data.only(chosen.indices).model(
            best.mean, best.covariance, best.noise_variance, identifier=self, theta_dof=2 * best.a)
        self.terms_ = self.model_.terms
        return self

    def _prune(self, data: Regression, statistics: Statistics) -> tuple[list[PruningStep], Posterior]:
        """Fit and prune down to one term; return all steps and the posterior of the best."""
        priors = Priors(a0=self.a0, b0=self.b0, c0=self.c0, d0=self.d0)
        indices = np.arange(statistics.moment.size)
        alpha = np.full(indices.size, priors.c0 / priors.d0)
        steps: list[PruningStep] = []
        best: Posterior | None = None
        while True:
            fit = fit_relevance(statistics.only(indices), priors, alpha, tolerance=self.tolerance,
                                max_iterations=self.max_iterations)
            if best is None or fit.bounds[-1] > max(step.lower_bound for step in steps):
                best = fit.posterior
            scale = -np.log(fit.alpha)
            threshold = scale.min() + (scale.max() - scale.min()) / self.resolution
            steps.append(PruningStep(
                terms=tuple(data.table.terms[i] for i in indices), indices=indices, relevance=1 / fit.alpha,
                threshold=float(np.exp(threshold)), bounds=fit.bounds))
            if indices.size == 1:
                return steps, best
            keep = scale > threshold
            if not keep.any():  # all equally relevant: still one must go
                keep[1:] = True
            indices, alpha = indices[keep], fit.alpha[keep]
