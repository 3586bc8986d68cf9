"""Sparse variational Bayes: NARX structure and parameters by relevance determination and pruning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.bayes import Posterior, Priors, Statistics, fit_relevance
from deatwin.ident.narx.identifier import NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Lags, Rule, Term
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]


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
        1 / E[alpha] of each, for regressors of root mean square about 1.
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

    With ``y | theta, tau ~ N(Phi theta, 1/tau)``, ``theta | tau, alpha ~ N(0, 1/(tau alpha))`` and gamma
    priors, the variational posterior of all candidates is iterated to convergence; the terms with the least
    relevance ``1/E[alpha]`` are pruned, those below ``min + (max - min)/resolution`` on a logarithmic scale;
    and so on, each step starting from the last relevances, down to one term. The step with the largest lower
    bound is the model (all models being equally probable beforehand).

    The priors have a size of their own, so that the choice depends on units and on the size of the
    regressors: small ones would be neither supported nor refused by the bound. Hence signals are divided by
    powers of two as `Regression` tells, and each regressor by the power of two nearest to its root mean
    square. Bounds and relevances are those of this scaling; the model is in physical units.

    Parameters
    ----------
    output_lags, input_lags : int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples.
    degree : int
        Largest degree of a candidate.
    rule : callable, optional
        Takes a `Term` and says whether it is a candidate; see `deatwin.ident.narx.rules`.
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
        The chosen model, in physical units. The posterior of theta is Student-t with ``theta_dof = 2 a_N``
        degrees of freedom; ``theta_cov`` is its covariance, ``theta_cov (theta_dof - 2)/theta_dof`` its
        squared scale.
    terms_ : tuple of Term
        Its terms.
    lower_bound_ : float
        Its lower bound on ln p(y) in nats, in the scaling above.
    relevance_ : ndarray, shape (n_terms,)
        1 / E[alpha] of its terms, in the scaling above.
    path_ : tuple of PruningStep
        All steps, from all candidates down to one term.

    References
    ----------
    Jacobs, Baldacchino, Dodd, Anderson, "Sparse Bayesian nonlinear system identification using variational
    inference", IEEE Trans. Autom. Control 63 (2018), doi:10.1109/TAC.2018.2813004.
    Drugowitsch, "Variational Bayesian inference for linear and logistic regression", arXiv:1310.5438.
    """

    def __init__(
        self,
        *,
        output_lags: Lags = 2,
        input_lags: Lags = 2,
        degree: int = 2,
        rule: Rule | None = None,
        resolution: float = 100.0,
        a0: float = 1e-2,
        b0: float = 1e-4,
        c0: float = 1e-2,
        d0: float = 1e-4,
        tolerance: float = 1e-5,
        max_iterations: int = 500,
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.resolution = resolution
        self.a0 = a0
        self.b0 = b0
        self.c0 = c0
        self.d0 = d0
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def _check(self) -> None:
        if self.resolution <= 1 or self.max_iterations < 1 or min(self.a0, self.b0, self.c0, self.d0) <= 0:
            raise ModelError(
                "resolution must be above 1, max_iterations at least 1 and a0, b0, c0, d0 positive"
            )

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        if data.n_samples < 3:
            raise ModelError(f"{data.n_samples} usable samples are too few; at least 3 are needed")
        gram, moment, power = data.gram()
        statistics = Statistics(gram=gram, moment=moment, power=power, n_samples=data.n_samples)
        sizes = statistics.sizes
        steps, best = self._prune(data, statistics.divided(sizes))
        self.path_ = tuple(steps)
        chosen = max(steps, key=lambda step: step.lower_bound)
        self.lower_bound_ = chosen.lower_bound
        self.relevance_ = chosen.relevance
        sizes = sizes[chosen.indices]
        model = data.only(chosen.indices).model(
            best.mean / sizes,
            best.covariance / np.outer(sizes, sizes),
            best.noise_variance,
            identifier=self,
            theta_dof=2 * best.a,
        )
        self.terms_ = model.terms
        return model

    def _prune(self, data: Regression, statistics: Statistics) -> tuple[list[PruningStep], Posterior]:
        """Fit and prune down to one term; return all steps and the posterior of the best."""
        priors = Priors(a0=self.a0, b0=self.b0, c0=self.c0, d0=self.d0)
        indices = np.arange(statistics.moment.size)
        alpha = np.full(indices.size, priors.c0 / priors.d0)
        steps: list[PruningStep] = []
        best: Posterior | None = None
        while True:
            fit = fit_relevance(
                statistics.only(indices),
                priors,
                alpha,
                tolerance=self.tolerance,
                max_iterations=self.max_iterations,
            )
            if best is None or fit.bounds[-1] > max(step.lower_bound for step in steps):
                best = fit.posterior
            scale = -np.log(fit.alpha)
            threshold = scale.min() + (scale.max() - scale.min()) / self.resolution
            steps.append(
                PruningStep(
                    terms=tuple(data.table.terms[i] for i in indices),
                    indices=indices,
                    relevance=1 / fit.alpha,
                    threshold=float(np.exp(threshold)),
                    bounds=fit.bounds,
                )
            )
            if indices.size == 1:
                return steps, best
            keep = scale > threshold
            if not keep.any():  # all equally relevant: still one must go
                keep[1:] = True
            indices, alpha = indices[keep], fit.alpha[keep]
