"""Forward regression by orthogonal least squares with error reduction ratios (FROLS)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.arguments import one_of, probability, whole_number
from deatwin.ident.narx.estimate import Estimator, least_squares, require_estimator
from deatwin.ident.narx.forward import (
    CRITERIA,
    SelectionStep,
    criterion_values,
    forward_selection,
    free_run_errors,
    split,
)
from deatwin.ident.narx.identifier import CandidateSearch, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(kw_only=True, eq=False, repr=False)
class Frols(CandidateSearch):
    """Choose terms one by one, each time the term that explains most of the unexplained output (FROLS).

    The error reduction ratio of a candidate term is ``(w'y)^2 / (w'w y'y)``. Here y is the output, and w is the
    candidate's regressor, orthogonalised against the regressors of the terms chosen before. Terms are added up to
    ``max_terms``. A criterion then decides how many of them are kept, and the parameters of these are estimated.

    Parameters
    ----------
    output_lags, input_lags : int, sequence, or mapping of str to int or sequence of int
        Lags in samples: a number n for 1..n, or a list of lags. An input lag may be 0. One value applies to all
        channels. Separate values are given in the order of the channels, as ``[[1, 2], [4, 5]]``, or by name, as
        ``{"u": [1, 2], "w": [4, 5]}``.
    degree : int
        Largest degree of a candidate term.
    functions : sequence of str
        Functions of lagged signals that may be factors of candidate terms, as ``["|u(k-1)|", "sat(y(k-1),0.5)"]``; see
        `register_function`. A term contains each function at most once.
    rule : callable, optional
        Function that takes a `Term` and returns True if the term may be a candidate.
    max_terms : int
        Largest number of terms.
    criterion : str
        Criterion whose minimum decides the number of terms. With n samples, k terms, p candidates and the mean squared
        residual s, it is:

        - "ebic", ``n ln s + k ln n + 2 ln C(p, k) + 2 ln(p + 1)`` with the binomial coefficient C(p, k), which keeps
          its largest value for k above p/2: the extended Bayesian information criterion, which avoids false terms even
          among many candidates;
        - "bic", ``n ln s + k ln n``, or "aic", ``n ln s + 2 k``: these ignore the number of candidates, and keep false
          terms if there are hundreds of candidates;
        - "free_run", the mean squared free-run error on the held-out samples;
        - "none": no criterion, all ``max_terms`` terms are kept.
    held_out : float
        Share of each recording, at its end, that is held out, for "free_run" only. Terms are then chosen on the other
        samples; the parameters of the kept terms are estimated on all samples.
    estimator : callable
        Estimator of the parameters; least squares by default. Another one is for example `TotalLeastSquares`.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units. With least squares, ``theta_cov`` is ``sigma^2 (P'P)^-1`` with the
        residual variance sigma^2 and the regressors P.
    terms_ : tuple of Term
        Terms of the model, in the order in which they were chosen.
    err_ : ndarray, shape (n_terms,)
        Error reduction ratio of each term, dimensionless. The sum of all ratios is the explained share of y'y.
    path_ : tuple of Term
        All terms that were added, in the order in which they were chosen. The first ones are ``terms_``.
    path_err_ : ndarray, shape (n_path,)
        Error reduction ratio of each term of ``path_``.
    criterion_ : ndarray, shape (n_path,)
        Value of the criterion with the first 1, 2, ... terms of ``path_``; empty for "none". For "free_run" in the
        square of the output's unit.

    References
    ----------
    Chen, Billings, Luo, "Orthogonal least squares methods and their application to non-linear system
    identification", Int. J. Control 50 (1989) 1873-1896, doi:10.1080/00207178908953472.
    Chen, Chen, "Extended Bayesian information criteria for model selection with large model spaces", Biometrika 95
    (2008) 759-771, doi:10.1093/biomet/asn034 (here with gamma = 1).

    Examples
    --------
    >>> u, y = np.random.default_rng(0).normal(size=300), np.zeros(300)
    >>> for k in range(1, 300):
    ...     y[k] = 0.5 * y[k - 1] + u[k - 1] ** 2
    >>> print(Frols().fit(Recording.from_arrays(u, y, 0.02)).model_)
    y(k) = 1 u(k-1)^2 + 0.5 y(k-1) + e(k)
    """

    max_terms: int = 15
    criterion: str = "ebic"
    held_out: float = 0.3
    estimator: Estimator = least_squares

    def _check(self) -> None:
        one_of(self.criterion, "criterion", (*CRITERIA, "free_run", "none"))
        whole_number(self.max_terms, "max_terms")
        probability(self.held_out, "held_out")
        require_estimator(self.estimator)

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        training: Regression = data
        held_out: tuple[Recording, ...] = ()
        if self.criterion == "free_run":
            beginnings, held_out = split(data.recordings, self.held_out, data.first)
            training = replace(data, recordings=beginnings)
        training.require_samples_for(self.max_terms)
        rows, target = training.matrix()
        steps = self._select(rows, target, progress)
        del rows  # free the working memory of the selection
        if not steps:
            raise ModelError("every candidate is zero throughout: there is nothing to choose from")
        path = [step.candidate for step in steps]
        self.path_ = tuple(data.table.terms[i] for i in path)
        self.path_err_ = np.array([step.err for step in steps])
        if self.criterion == "none":
            self.criterion_, count = np.empty(0), len(path)
        else:
            if self.criterion == "free_run":
                self.criterion_ = self._free_run_errors(training.only(path), held_out, progress)
            else:
                self.criterion_ = criterion_values(self.criterion, steps, target, len(data.table.terms))
            count = int(np.argmin(self.criterion_)) + 1
        self.terms_, self.err_ = self.path_[:count], self.path_err_[:count]
        kept = data.only(path[:count])
        found = self.estimator(*kept.matrix())
        return kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self, theta_dof=found.dof)

    def _select(self, rows: Array, target: Array, progress: Progress) -> list[SelectionStep]:
        """Choose terms one by one; after an interrupt, keep those already chosen."""
        steps: list[SelectionStep] = []
        share = 0.2 if self.criterion == "free_run" else 1.0
        with self._keeping(lambda: steps):
            for step in forward_selection(rows, target, self.max_terms):
                steps.append(step)
                done = share * len(steps) / self.max_terms
                progress(done, f"term {len(steps)}, {step.err:.3%} of the output explained")
        return steps

    def _free_run_errors(self, path: Regression, held_out: tuple[Recording, ...], progress: Progress) -> Array:
        """Return mean squared free-run errors on held-out data of models with the first 1, 2, ... chosen terms."""
        rows, target = path.matrix()
        errors = np.full(len(rows), np.inf)
        with self._keeping(lambda: np.isfinite(errors).any()):
            for k in range(1, len(rows) + 1):
                theta = np.zeros((1, len(rows)))
                theta[0, :k] = self.estimator(rows[:k], target).theta
                errors[k - 1] = free_run_errors(path.only(range(k)), held_out, theta[:, :k])[0]
                progress(0.2 + 0.8 * k / len(rows), f"free run with {k} terms")
        return errors * path.output_scale**2
