"""Sparse variational Bayes: NARX structure and parameters by relevance determination and pruning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import one_of, positive, whole_number
from deatwin.ident.narx.bayes import FLAT, Posterior, Priors, RelevanceFit, Statistics, fit_relevance
from deatwin.ident.narx.evidence import Move, climb, log_odds
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import CandidateSearch, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_NAMED = 10  # most paths with a label of their own, as many as there are colours


@dataclass(frozen=True, kw_only=True, eq=False)
class PruningStep(Described):
    """One step of the pruning by `SvbNarx`.

    Parameters
    ----------
    terms : tuple of Term
        The terms fitted in this step.
    indices : ndarray of int, shape (n_terms,)
        Positions of these terms among the candidates, from 0.
    relevance : ndarray, shape (n_terms,)
        Relevance of each term: 1 / E[alpha], where alpha is the prior precision of the term's parameter. All regressors
        are scaled to a root mean square of about 1.
    threshold : float
        Terms whose relevance does not exceed this threshold are pruned next.
    bounds : tuple of float
        Variational lower bound of the log evidence after each update, in nats.
    """

    terms: tuple[Term, ...]
    indices: NDArray[np.intp] = field(metadata=variable("term", name="index", about="position among the candidates"))
    relevance: Array = field(
        metadata=variable("term", about="1 / E[alpha], for regressors of root mean square about 1")
    )
    threshold: float = field(metadata=attribute())
    bounds: tuple[float, ...] = field(
        metadata=variable("update", name="bound", unit="nat", about="lower bound of the log evidence")
    )

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "term": coordinate("term", of=lambda step: np.array([str(term) for term in step.terms], dtype=str)),
    }

    @property
    def lower_bound(self) -> float:
        """Lower bound of the log evidence after the last update, in nats."""
        return self.bounds[-1]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw on `ax` or new axes the relevance of each term, the threshold, and the terms that are pruned."""
        axes = axes_or_new(ax)
        kept = self.relevance > self.threshold
        for chosen, style, label in ((kept, "o", "kept"), (~kept, "x", "pruned")):
            axes.plot(self.indices[chosen], self.relevance[chosen], style, markersize=4, label=label)
        axes.axhline(self.threshold, color="0.4", linestyle="--", label="threshold")
        axes.set(yscale="log", xlabel="candidate", ylabel="relevance 1/E[α]", title=f"{len(self.terms)} terms")
        axes.legend()
        return axes


def draw_bounds(path: Sequence[PruningStep], ax: Axes | None = None) -> Axes:
    """Draw the lower bound over the pruning steps, with the largest marked."""
    axes = axes_or_new(ax)
    bounds = np.array([step.lower_bound for step in path])
    best = int(np.argmax(bounds))
    steps = np.arange(1, bounds.size + 1)
    axes.plot(steps, bounds, marker=".")
    count = len(path[best].terms)
    axes.plot(
        steps[best],
        bounds[best],
        "o",
        color="C3",
        markersize=9,
        fillstyle="none",
        label=f"largest: step {steps[best]}, {count} term{'s' if count > 1 else ''}",
    )
    axes.set(xlabel="pruning step", ylabel="lower bound (nats)")
    axes.legend()
    return axes


def draw_relevance_paths(path: Sequence[PruningStep], ax: Axes | None = None) -> Axes:
    """Draw the relevance of each candidate over the pruning steps, until it is pruned."""
    axes = axes_or_new(ax)
    relevance = np.full((len(path), len(path[0].terms)), np.nan)
    for row, step in zip(relevance, path, strict=True):
        row[np.searchsorted(path[0].indices, step.indices)] = step.relevance
    lasting = np.argsort(np.isnan(relevance).sum(axis=0), kind="stable")
    steps = np.arange(1, len(path) + 1)
    axes.plot(steps, relevance[:, lasting[_NAMED:]], color="0.75", linewidth=0.6)
    for j in lasting[:_NAMED]:
        axes.plot(steps, relevance[:, j], label=str(path[0].terms[j]))
    bounds = [step.lower_bound for step in path]
    axes.axvline(int(np.argmax(bounds)) + 1, color="0.4", linestyle="--", label="largest bound")
    axes.set(yscale="log", xlabel="pruning step", ylabel="relevance 1/E[α]")
    axes.set_xlim(0, 1.6 * len(path))  # room for the names beside the paths
    axes.legend(fontsize="small", loc="upper right")
    return axes


_CLEAN_UPS = ("none", "evidence")
_PRUNING = 0.9  # share of the progress for pruning if a clean-up follows


@dataclass(kw_only=True, eq=False, repr=False)
class SvbNarx(CandidateSearch):
    """Choose terms by sparse variational Bayes: relevance determination, pruning, and the largest lower bound.

    The model is ``y | theta, tau ~ N(Phi theta, 1/tau)`` and ``theta | tau, alpha ~ N(0, 1/(tau alpha))`` with the
    output y, the regressors Phi and the parameters theta. The noise precision tau and the precision alpha of each term
    have gamma priors. The relevance of a term is ``1/E[alpha]``.

    Each pruning step computes the variational posterior of the present terms by iteration. It then removes the terms
    whose log relevance is at most ``min + (max - min)/resolution``, where min and max are the smallest and the largest
    log relevance. Every step starts from the prior mean of alpha, so that a term can become relevant again once other
    terms that described the same dynamics are removed. The steps continue down to one term. The model is that of the
    step with the largest variational lower bound of the evidence. Candidates that are zero throughout are ignored.

    The bound ignores the number of candidates: among hundreds, a false term sometimes raises the bound by chance. A
    clean-up (``clean_up="evidence"``), which is not part of the published algorithm, therefore continues the search.
    The clean-up removes, adds or exchanges one term at a time, always in the way that gives the most probable
    structure, until no change increases the probability. The clean-up runs twice. The first run starts from the most
    probable structure among those of the step with the largest bound and of all later steps. The second run starts
    from the structure of the last step. The more probable result is kept. The probability of a structure follows from its exact
    evidence under a unit-information prior and a prior that takes the number of candidates into account; see
    `deatwin.ident.narx.evidence`. The parameters always have their variational posterior.

    The choice of terms does not depend on units, because the output and the regressors are divided by their root mean
    squares. Signals far from zero are taken relative to an origin, about which the same polynomial may have other
    terms. Bounds and relevances refer to the scaled signals. The model is in physical units.

    Parameters
    ----------
    output_lags, input_lags, degree, functions, rule
        Candidate terms, as in `Frols`.
    clean_up : str
        Search after the published algorithm: "evidence" for the clean-up, "none" for no further search.
    resolution : float
        Resolution of the pruning, above 1; the larger the resolution, the fewer terms each step prunes.
    a0, b0, c0, d0 : float
        Shape and rate of the gamma priors of the noise precision (a0, b0) and of alpha (c0, d0).
    tolerance : float
        Tolerance of convergence, for two quantities: the change of the parameters in one update, in standard
        deviations, and the relative change of the noise variance.
    max_iterations : int
        Largest number of updates in a pruning step.

    Attributes
    ----------
    model_ : NarxModel
        Chosen model, in physical units. The posterior of theta is Student-t with ``theta_dof`` degrees of freedom and
        covariance ``theta_cov``.
    terms_ : tuple of Term
        Terms of the model.
    settled_ : bool
        True if the parameters converged within ``max_iterations`` updates. With several outputs, each estimator in
        ``equations_`` has this attribute and the following ones instead.
    lower_bound_ : float
        Variational lower bound of the log evidence ln p(y) of the model in nats, for scaled signals.
    relevance_ : ndarray, shape (n_terms,)
        Relevance 1/E[alpha] of each term, for scaled signals.
    path_ : tuple of PruningStep
        Pruning steps, from all candidates down to one term.

    References
    ----------
    Jacobs, Baldacchino, Dodd, Anderson, "Sparse Bayesian nonlinear system identification using variational
    inference", IEEE Trans. Autom. Control 63 (2018), doi:10.1109/TAC.2018.2813004.
    Drugowitsch, "Variational Bayesian inference for linear and logistic regression", arXiv:1310.5438.
    """

    clean_up: str = "evidence"
    resolution: float = 100.0
    a0: float = 1e-2
    b0: float = 1e-4
    c0: float = 1e-2
    d0: float = 1e-4
    tolerance: float = 1e-2
    max_iterations: int = 500

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        settled = all(one.settled_ for one in self.equations_ or (self,))  # type: ignore[attr-defined]
        late = f"the parameters had not settled after {self.max_iterations} updates: raise max_iterations"
        return super()._notes(recordings) + (() if settled else (late,))

    def _check(self) -> None:
        one_of(self.clean_up, "clean_up", _CLEAN_UPS)
        for name in ("resolution", "a0", "b0", "c0", "d0", "tolerance"):
            positive(getattr(self, name), name)
        if self.resolution <= 1:
            raise ModelError(f"resolution = {self.resolution}; it must be above 1")
        whole_number(self.max_iterations, "max_iterations")

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        resting = super()._resting(data, model)
        if resting is data:
            return data
        # The prior shrinks the parameters only slightly, but enough for exact data to keep a constant; least squares
        # avoids it.
        try:
            return super()._resting(data, Fixed(terms=model).fit(data[0].recordings).model_)
        except ModelError:  # too few samples for least squares
            return resting

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        if data.n_samples < 3:
            raise ModelError(f"{data.n_samples} usable samples are too few; at least 3 are needed")
        whole = data.statistics()
        if not whole.gram.any():
            raise ModelError("every candidate is zero throughout the recordings: there is nothing to choose from")
        statistics = whole.divided(whole.root_mean_squares, whole.output_size)
        self.path_ = self._pruned(data, statistics, progress)
        best = max(range(len(self.path_)), key=lambda s: self.path_[s].lower_bound)
        chosen = self.path_[best].indices
        if self.clean_up == "evidence" and self.status_.ok:
            move = self._climbed(statistics, self.path_[best:], progress)
            chosen = chosen if move is None else move.chosen
        # The bound may have several maxima. The final fit is the better of two: one started without any term, one at
        # least squares, from where nearly collinear terms find their shares.
        starts = (self.c0 / self.d0, FLAT)
        fit = max((self._fit(statistics.only(chosen), start) for start in starts), key=lambda one: one.bounds[-1])
        self.settled_ = fit.settled
        self.lower_bound_, self.relevance_ = fit.bounds[-1], 1 / fit.alpha
        model = model_of(fit.posterior, data.only(chosen), whole.only(chosen), self)
        self.terms_ = model.terms
        progress(1.0, f"{len(model.terms)} terms, lower bound {self.lower_bound_:.6g}")
        return model

    def _pruned(self, data: Regression, statistics: Statistics, progress: Progress) -> tuple[PruningStep, ...]:
        """Return the pruning steps; after an interrupt, those finished so far."""
        steps: list[PruningStep] = []
        candidates = statistics.moment.size
        part = _PRUNING if self.clean_up == "evidence" else 1.0
        with self._keeping(lambda: steps):
            for step in self._steps(data, statistics):
                steps.append(step)
                left = step.indices.size
                # The cost of a fit grows with the cube of its terms.
                progress(part * (1 - (left / candidates) ** 3), f"{left} terms, lower bound {step.lower_bound:.6g}")
        return tuple(steps)

    def _steps(self, data: Regression, statistics: Statistics) -> Iterator[PruningStep]:
        """Fit and prune down to one term."""
        indices = np.flatnonzero(np.diag(statistics.gram))
        while True:
            fit = self._fit(statistics.only(indices), self.c0 / self.d0)
            scale = -np.log(fit.alpha)
            threshold = scale.min() + (scale.max() - scale.min()) / self.resolution
            yield PruningStep(
                terms=tuple(data.table.terms[i] for i in indices),
                indices=indices,
                relevance=1 / fit.alpha,
                threshold=float(np.exp(threshold)),
                bounds=fit.bounds,
            )
            if indices.size == 1:
                return
            keep = scale > threshold
            if not keep.any():  # if all are equally relevant, one must still be removed
                keep[1:] = True
            indices = indices[keep]

    def _fit(self, statistics: Statistics, start: float) -> RelevanceFit:
        """Compute the posterior of some terms, initially with one common E[alpha]."""
        priors = Priors(a0=self.a0, b0=self.b0, c0=self.c0, d0=self.d0)
        return fit_relevance(
            statistics,
            priors,
            np.full(statistics.moment.size, start),
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
        )

    def _climbed(self, statistics: Statistics, steps: Sequence[PruningStep], progress: Progress) -> Move | None:
        """Return the move to the most probable structure found; None if it was interrupted before the first."""
        best: Move | None = None
        made = 0
        with self._keeping():
            start = max((step.indices for step in steps), key=lambda indices: log_odds(statistics, indices))
            for beginning in (start, steps[-1].indices):
                for move in climb(statistics, beginning):
                    if best is None or move.log_odds > best.log_odds:
                        best = move
                    made += 1
                    share = 1 - (1 - _PRUNING) / (made + 1)  # the number of moves is not known beforehand
                    progress(share, f"clean-up: {move.chosen.size} terms, log-odds {move.log_odds:.6g}")
        return best

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the lower bound over the pruning steps, with the largest bound marked, on `ax` or new axes."""
        return draw_bounds(self.path_, ax)


def model_of(found: Posterior, data: Regression, given: Statistics, identifier: SvbNarx) -> NarxModel:
    """Return the model of a posterior of regressors and output that were divided by their root mean squares."""
    scales = given.root_mean_squares / given.output_size
    return data.model(
        found.mean / scales,
        found.covariance / np.outer(scales, scales),
        found.noise_variance * given.output_size**2,
        identifier=identifier,
        theta_dof=2 * found.a,
    )
