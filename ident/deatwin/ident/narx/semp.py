"""Simulation-error minimisation with pruning (SEMP): terms are judged by the free run of the model they make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.growth import grown, run_errors, white
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.semp_search import SempSearch, SempStep
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]

# A free run that goes astray in one section alone passes every test over the sections. Whatever they say, the final
# model's mean squared error is at most so many times the least of the path: a choice, far beyond what chance does.
_CLEARLY_WORSE = 2.0


class Semp(NarxIdentifier):
    """Add the term that most lowers the error of the free run, prune, and so on.

    In every step the parameters of each model with one candidate more are estimated by least squares, all these models
    are run free, and the candidate with the largest simulation error reduction ratio is added,
    ``SRR = (MSSE(M) - MSSE(M + x)) / mean(y^2)`` with the mean squared simulation error MSSE. Then terms are pruned as
    long as the model without one simulates better than the model before the addition.

    The simulation error is one number of one noisy record: among many candidates it is often lowered more by a false
    term than by the true one. Two tests therefore stand beside the published rules, and are switched off by
    ``level=0.5, significance=None``:

    - Simulation errors are compared by a paired t test on the sums over about twenty sections of the records. Only
      what is better at this level counts as better; of the candidates that simulate as well as the best of them, the
      one that lowers the one-step error most is added, if the free run is no worse with it.
    - A term is a candidate only if it lowers the one-step error significantly (F test, its level divided by the number
      of candidates that compete), and is pruned when it does so no longer and the free run is no worse without it.

    Additions end when no candidate is left, at ``max_terms``, or when the SRR is below ``threshold``. Then, which is
    not published either and is switched off by ``max_exchanges=0``, a term is exchanged for a candidate that makes the
    free run better, or the one-step error smaller and the free run no worse; and once the search goes on from that
    model of the forward regression that simulates best, if it does so better than the present one: a resonance, for
    one, cannot always be found by adding single terms to what simulates well. The search ends there; or, where a free
    run went astray in a few sections only, which no test over them sees, at the last step whose mean squared error is
    at most twice the least.

    Least squares and the F test hold where the one-step errors are white. If they are not, as with noise on the
    readings, the model grows on (single output, and not with ``max_exchanges=0``): its parameters are refined to the
    least free-run error, and terms are added by that error up to ``max_terms`` (`extend`). Of this path the first model
    is taken from which on none is significantly worse, over held-out sections, than the best.

    Parameters
    ----------
    output_lags, input_lags : int, sequence, or mapping of str to int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples; for every channel, or
        for each: in order, as ``[[1, 2], [4, 5]]``, or by name, as ``{"u": [1, 2], "w": [4, 5]}``.
    degree : int
        Largest degree of a candidate.
    rule : callable, optional
        Takes a `Term` and says whether it is a candidate; see `deatwin.ident.narx.rules`.
    max_terms : int
        Largest number of terms.
    threshold : float, optional
        Least SRR of an addition, as published; dimensionless. Without it the tests alone decide.
    level : float
        One-sided level of the test between simulation errors, above 0; 0.5 takes every difference as real.
    significance : float, optional
        Probability with which any of the false candidates of a step enters a true model; None for no test.
    max_exchanges : int
        How often a term may be exchanged for a candidate when no addition is left; 0 for the published search alone.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units; ``theta_cov`` is ``sigma^2 (P'P)^-1``; if it has grown, as of `refine`.
    terms_ : tuple of Term
        Its terms.
    path_ : tuple of SempStep
        The steps of the search.
    srr_ : ndarray, shape (n_steps,)
        Simulation error reduction ratio of each step before pruning, dimensionless.
    msse_ : ndarray, shape (n_steps,)
        Mean squared simulation error after each step, square of the output's unit.

    References
    ----------
    Piroddi, Spinelli, "An identification algorithm for polynomial NARX models based on simulation error minimization",
    Int. J. Control 76 (2003) 1767-1781, doi:10.1080/00207170310001635419. Tests and exchanges are not from there.
    """

    def __init__(
        self,
        *,
        output_lags: Lags = 2,
        input_lags: Lags = 2,
        degree: int = 2,
        rule: Rule | None = None,
        max_terms: int = 15,
        threshold: float | None = None,
        level: float = 0.01,
        significance: float | None = 0.01,
        max_exchanges: int = 20,
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.max_terms = max_terms
        self.threshold = threshold
        self.level = level
        self.significance = significance
        self.max_exchanges = max_exchanges

    def _check(self) -> None:
        if self.max_terms < 1:
            raise ModelError(f"max_terms = {self.max_terms}; it must be at least 1")
        if self.max_exchanges < 0:
            raise ModelError(f"max_exchanges = {self.max_exchanges}; it must not be negative")
        if not 0 < self.level <= 0.5:
            raise ModelError(f"level = {self.level}; it must lie above 0 and not above 0.5")
        if self.significance is not None and not 0 < self.significance < 1:
            raise ModelError(f"significance = {self.significance}; it must lie between 0 and 1, or be None")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        data.require_samples_for(self.max_terms + 1)
        search, share = SempSearch(self, data), 0.0
        try:
            while search.advance():
                share = max(share, min(len(search.chosen) / self.max_terms, 0.99))
                error = search.path[-1].msse ** 0.5
                progress(share, f"{len(search.chosen)} terms, free-run error {error:.4g} rms")
        except KeyboardInterrupt:
            if not search.path:
                raise
            self.status_ = FitStatus.INTERRUPTED
        if not search.path:
            raise ModelError("no candidate alone makes a model whose free run stays finite")
        least = min(step.msse for step in search.path)
        final = [step for step in search.path if step.msse <= _CLEARLY_WORSE * least][-1]
        kept = data.only([data.table.terms.index(term) for term in final.terms])
        found = least_squares(*kept.matrix())
        model = kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)
        steps = list(search.path)
        if self.max_exchanges and self.status_.ok and len(data.recordings[0].outputs) == 1 and not white(model, data):
            for larger in self._grown(model, data, search.sections, progress):
                steps.append(_grown_step(model, larger, data))
                model = larger
        self.path_ = tuple(steps)
        self.srr_ = np.array([step.srr for step in steps])
        self.msse_ = np.array([step.msse for step in steps])
        self.terms_ = model.terms
        progress(1.0, f"{len(self.terms_)} terms")
        return model

    def _grown(
        self, model: NarxModel, data: Regression, sections: NDArray[np.int64], progress: Progress
    ) -> tuple[NarxModel, ...]:
        """Return the models of the growth; an interrupt, which ends it with what there is, is noted."""

        def tell(share: float, doing: str) -> None:
            try:
                progress(0.99, f"growing by the free-run error: {doing}")
            except KeyboardInterrupt:
                self.status_ = FitStatus.INTERRUPTED
                raise

        return grown(model, data, sections.tolist(), max_terms=self.max_terms, level=self.level, progress=tell)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the simulation error reduction ratio of each step on a logarithmic axis, and the threshold.

        A step that made the simulation error larger, as the tests allow within its uncertainty, has no point.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        steps = np.arange(1, len(self.path_) + 1)
        axes.semilogy(steps, np.where(self.srr_ > 0, self.srr_, np.nan), "o-", label="SRR")
        if self.threshold is not None:
            axes.axhline(self.threshold, color="tab:red", linestyle="--", label="threshold")
        labels = [
            "\n".join([*(f"+ {term}" for term in step.added), *(f"− {term}" for term in step.pruned)])
            for step in self.path_
        ]
        axes.set_xticks(steps, labels, rotation=60, ha="right", fontsize="small")
        axes.set_ylabel("simulation error reduction ratio")
        axes.legend(loc="upper right")
        return axes


def _grown_step(before: NarxModel, after: NarxModel, data: Regression) -> SempStep:
    """Return the step from a model to a refined one, mostly with a term more."""
    outputs = np.concatenate([r.outputs[0, data.first :] for r in data.recordings])
    power = float(np.mean((outputs - before.output_origin[0]) ** 2))
    old, new = (float(np.mean(np.concatenate(run_errors(model, data)) ** 2)) for model in (before, after))
    added = tuple(term for term in after.terms if term not in before.terms)
    return SempStep(added=added, pruned=(), terms=after.terms, srr=(old - new) / power, msse=new)
