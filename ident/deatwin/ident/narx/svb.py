"""Sparse variational Bayes: NARX structure and parameters by relevance determination and pruning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.bayes import FLAT, Priors, RelevanceFit, Statistics, fit_relevance
from deatwin.ident.narx.evidence import Move, climb, log_odds
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.origin import about_rest
from deatwin.ident.narx.pruning import PruningStep, draw_bounds
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Lags, Rule, Term
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]

_CLEAN_UPS = ("none", "evidence")
_PRUNING = 0.9  # share of the progress that is pruning where a clean-up follows


@dataclass(frozen=True, kw_only=True)
class CleanUpMove:
    """One move of the clean-up.

    Parameters
    ----------
    removed, added : Term or None
        What it changed: one of them, or both for an exchange; None and None for the step where it began.
    terms : tuple of Term
        The terms after it.
    log_odds : float
        ln p(structure | y) after it, less that of the structure without any term, in nats.
    """

    removed: Term | None
    added: Term | None
    terms: tuple[Term, ...]
    log_odds: float


class SvbNarx(NarxIdentifier):
    """Sparse variational Bayesian NARX: relevance determination, pruning, choice by the largest lower bound.

    With ``y | theta, tau ~ N(Phi theta, 1/tau)``, ``theta | tau, alpha ~ N(0, 1/(tau alpha))`` and gamma
    priors, the variational posterior of all candidates is iterated to convergence; the terms with the least
    relevance ``1/E[alpha]`` are pruned, those up to ``min + (max - min)/resolution`` on a logarithmic scale;
    and so on down to one term. Each step starts afresh from the prior mean of the relevances, so that a term
    that others stood in for gets its weight back once they are gone. The step with the largest lower bound is
    the model (all models being equally probable beforehand). Candidates that are zero throughout take no part.

    The bound does not count how many candidates compete: among hundreds, a false term raises it by chance now and
    then. The clean-up (``clean_up="evidence"``), which is not part of the published algorithm, goes on from there:
    beginning with the most probable of the last steps, from the one of the largest bound on, it removes, adds or
    exchanges one term at a time, always to the most probable structure, until no such move makes it more probable; then
    it does so again from the very last step, and keeps the more probable end. Structures are compared by their exact
    evidence under a unit-information prior and by a prior that counts the candidates; see
    `deatwin.ident.narx.evidence`. The posterior of the parameters is the variational one in either case.

    The priors have a size of their own, so that the choice depends on units and on the size of the
    regressors: small ones would be neither supported nor refused by the bound. Hence output and regressors are
    divided by their root mean squares, and a signal that is far from zero counts from an origin among its values:
    zero where the data reach about that far, else their mean; where any signal does so, the outputs then count from
    where the model rests. Neither units nor offsets of the others change the choice. Bounds and relevances are
    those of this scaling; the model is in physical units, about these origins.

    Parameters
    ----------
    output_lags, input_lags : int, sequence, or mapping of str to int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples; for every channel, or
        for each: in order, as ``[[1, 2], [4, 5]]``, or by name, as ``{"u": [1, 2], "w": [4, 5]}``.
    degree : int
        Largest degree of a candidate.
    rule : callable, optional
        Takes a `Term` and says whether it is a candidate.
    clean_up : str
        "evidence" for the clean-up after the published algorithm, "none" for that algorithm alone.
    resolution : float
        The larger, the fewer terms a step prunes; above 1.
    a0, b0, c0, d0 : float
        Shapes and rates of the gamma priors of noise precision and relevances.
    tolerance : float
        A step has converged when an update moves its parameters by less than this many of their standard deviations,
        and its noise variance by less than this share of itself.
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
    settled_ : bool
        Whether its parameters had settled within ``max_iterations``; with several outputs it is found on each of
        ``equations_``, as all that follows.
    lower_bound_ : float
        Its lower bound on ln p(y) in nats, in the scaling above.
    relevance_ : ndarray, shape (n_terms,)
        1 / E[alpha] of its terms, in the scaling above.
    path_ : tuple of PruningStep
        All steps, from all candidates down to one term.
    moves_ : tuple of CleanUpMove
        Of the clean-up, from where it began; empty with ``clean_up="none"``.

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
        clean_up: str = "evidence",
        resolution: float = 100.0,
        a0: float = 1e-2,
        b0: float = 1e-4,
        c0: float = 1e-2,
        d0: float = 1e-4,
        tolerance: float = 1e-2,
        max_iterations: int = 500,
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.clean_up = clean_up
        self.resolution = resolution
        self.a0 = a0
        self.b0 = b0
        self.c0 = c0
        self.d0 = d0
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        settled = all(one.settled_ for one in self.equations_ or (self,))  # type: ignore[attr-defined]
        late = f"the parameters had not settled after {self.max_iterations} updates: raise max_iterations"
        return super()._notes(recordings) + (() if settled else (late,))

    def _check(self) -> None:
        if self.clean_up not in _CLEAN_UPS:
            raise ModelError(
                f"clean_up = {self.clean_up!r}{nearest(self.clean_up, _CLEAN_UPS)}; known are {', '.join(_CLEAN_UPS)}"
            )
        if self.resolution <= 1 or self.max_iterations < 1 or min(self.a0, self.b0, self.c0, self.d0) <= 0:
            raise ModelError("resolution must be above 1, max_iterations at least 1 and a0, b0, c0, d0 positive")

    def _learn_all(self, data: list[Regression], progress: Progress) -> NarxModel:
        model = super()._learn_all(data, progress)
        resting = about_rest(data, model) if self.status_.ok else data
        return model if resting is data else super()._learn_all(resting, progress)

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        if data.n_samples < 3:
            raise ModelError(f"{data.n_samples} usable samples are too few; at least 3 are needed")
        gram, moment, power = data.gram()
        statistics = Statistics(gram=gram, moment=moment, power=power, n_samples=data.n_samples)
        if not gram.any():
            raise ModelError("every candidate is zero throughout the recordings: there is nothing to choose from")
        sizes, output_size = statistics.root_mean_squares, statistics.output_size
        statistics = statistics.divided(sizes, output_size)
        self.path_ = self._pruned(data, statistics, progress)
        best = max(range(len(self.path_)), key=lambda s: self.path_[s].lower_bound)
        chosen = self.path_[best].indices
        moves: list[Move] = []
        if self.clean_up == "evidence" and self.status_.ok:
            moves = self._climbed(statistics, self.path_[best:], progress)
            chosen = moves[-1].chosen if moves else chosen
        self.moves_ = tuple(_in_terms(move, data.table.terms) for move in moves)
        # The bound may have several maxima. The lasting fit is the better of that which began without any term and that
        # which began at least squares, from where nearly collinear terms find their shares.
        starts = (self.c0 / self.d0, FLAT)
        fit = max((self._fit(statistics.only(chosen), start) for start in starts), key=lambda one: one.bounds[-1])
        self.settled_ = fit.settled
        self.lower_bound_, self.relevance_ = fit.bounds[-1], 1 / fit.alpha
        found, scales = fit.posterior, sizes[chosen] / output_size
        model = data.only(chosen).model(
            found.mean / scales,
            found.covariance / np.outer(scales, scales),
            found.noise_variance * output_size**2,
            identifier=self,
            theta_dof=2 * found.a,
        )
        self.terms_ = model.terms
        progress(1.0, f"{len(model.terms)} terms, lower bound {self.lower_bound_:.6g}")
        return model

    def _pruned(self, data: Regression, statistics: Statistics, progress: Progress) -> tuple[PruningStep, ...]:
        """Return the steps of the pruning; an interrupt keeps those that are done."""
        steps: list[PruningStep] = []
        candidates = statistics.moment.size
        part = _PRUNING if self.clean_up == "evidence" else 1.0
        try:
            for step in self._steps(data, statistics):
                steps.append(step)
                left = step.indices.size
                # A fit costs the cube of its terms.
                progress(part * (1 - (left / candidates) ** 3), f"{left} terms, lower bound {step.lower_bound:.6g}")
        except KeyboardInterrupt:
            if not steps:
                raise
            self.status_ = FitStatus.INTERRUPTED
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
            if not keep.any():  # all equally relevant: still one must go
                keep[1:] = True
            indices = indices[keep]

    def _fit(self, statistics: Statistics, start: float) -> RelevanceFit:
        """Infer the posterior of some terms, all of them of one E[alpha] to start with."""
        priors = Priors(a0=self.a0, b0=self.b0, c0=self.c0, d0=self.d0)
        return fit_relevance(
            statistics,
            priors,
            np.full(statistics.moment.size, start),
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
        )

    def _climbed(self, statistics: Statistics, steps: Sequence[PruningStep], progress: Progress) -> list[Move]:
        """Return the moves to the most probable structure that is reached; an interrupt keeps those that are done."""
        best: list[Move] = []
        made = 0
        try:
            start = max((step.indices for step in steps), key=lambda indices: log_odds(statistics, indices))
            for beginning in (start, steps[-1].indices):
                moves: list[Move] = []
                for move in climb(statistics, beginning):
                    moves.append(move)
                    if not best or move.log_odds > best[-1].log_odds:
                        best = moves
                    made += 1
                    share = 1 - (1 - _PRUNING) / (made + 1)  # nobody knows how many moves there will be
                    progress(share, f"clean-up: {move.chosen.size} terms, log-odds {move.log_odds:.6g}")
        except KeyboardInterrupt:
            self.status_ = FitStatus.INTERRUPTED
        return best

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the lower bound over the pruning steps, with the largest marked.

        The other pictures are in `deatwin.ident.narx.pruning`.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        return draw_bounds(self.path_, ax)


def _in_terms(move: Move, terms: tuple[Term, ...]) -> CleanUpMove:
    """Return a move in terms instead of positions."""
    return CleanUpMove(
        removed=None if move.removed is None else terms[move.removed],
        added=None if move.added is None else terms[move.added],
        terms=tuple(terms[i] for i in move.chosen),
        log_odds=move.log_odds,
    )
