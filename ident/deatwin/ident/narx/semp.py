"""Simulation-error minimisation with pruning (SEMP): terms are judged by the free run of the model they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, real_number, whole_number
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.identifier import CandidateSearch, FitStatus, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.notes import late_inputs
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.semp_search import SempSearch, SempStep, grown, run_errors, white
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

# Largest mean squared error of the final model, as a multiple of the smallest of the path: a free run that fails in a
# single section passes every test over the sections.
_CLEARLY_WORSE = 2.0


@dataclass(kw_only=True, eq=False, repr=False)
class Semp(CandidateSearch):
    """Choose terms by simulation-error minimisation with pruning (SEMP).

    Each step adds the candidate x to the model M whose least-squares fit has the largest simulation error reduction
    ratio, ``SRR = (MSSE(M) - MSSE(M + x)) / mean(y^2)``; MSSE is the mean squared simulation error. Terms are then pruned
    as long as the pruned model has a smaller MSSE than the model before the addition.

    In noisy recordings, a false term among many candidates often lowers the MSSE more than the true term. Two tests are
    therefore added to the published method; ``level=0.5, significance=None`` switches them off:

    - Simulation errors are compared by a paired t test on their sums over about twenty sections of the recordings. Of
      the candidates that are not significantly worse than the best, at ``level``, the one with the smallest one-step
      error is added, provided that the free run does not become worse.
    - A term is a candidate only if it lowers the one-step error significantly (F test at ``significance`` divided by
      the number of candidates). A term that no longer does so is pruned, with the same proviso.

    Additions end when no candidate is left, when the model has ``max_terms`` terms, or when the SRR is below
    ``threshold``. Two further kinds of steps follow, which are not part of the published method either
    (``max_exchanges=0`` switches them off). A term is exchanged for a candidate that improves the free run, or that
    lowers the one-step error without worsening the free run. And the search continues once from the best model of a
    forward regression (`Frols`) if its MSSE is smaller, which finds resonances, for example.

    The result is the model of the last step whose MSSE is at most twice the smallest MSSE of all steps. If its one-step
    errors are not white, for example because of noise on the readings, least squares and the F test are not valid. The
    model is then extended (single output only, and not with ``max_exchanges=0``): its parameters are refined to the
    smallest free-run error, and terms that lower this error are added up to ``max_terms``. The result is the extended
    model with the smallest free-run error on held-out sections, or one with fewer terms whose error is not significantly
    larger.

    Parameters
    ----------
    output_lags, input_lags, degree, functions, rule
        Candidate terms, as in `Frols`.
    max_terms : int
        Largest number of terms.
    threshold : float, optional
        Smallest SRR for which a term is added (the stopping rule of the published method), dimensionless. If omitted,
        the two tests alone decide.
    level : float
        One-sided significance level of the t test between simulation errors, above 0 and at most 0.5. At 0.5, every
        difference is significant.
    significance : float, optional
        Probability that a step adds a false term to a model that lacks no true term; None switches the F test off.
    max_exchanges : int
        Largest number of exchanges; 0 switches off the exchanges, the forward regression and the extension.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units. ``theta_cov`` is ``sigma^2 (P'P)^-1`` with the residual variance
        sigma^2 and the regressors P; for an extended model, it is that of `refine`.
    terms_ : tuple of Term
        Terms of the model.
    path_ : tuple of SempStep
        Steps of the search.
    refined_ : bool
        True if the parameters were refined to the smallest free-run error. With several outputs, each estimator in
        ``equations_`` has this attribute and the following ones instead.
    srr_ : ndarray, shape (n_steps,)
        Simulation error reduction ratio of each step before pruning, dimensionless.
    msse_ : ndarray, shape (n_steps,)
        Mean squared simulation error after each step, in the squared unit of the output.

    References
    ----------
    Piroddi, Spinelli, "An identification algorithm for polynomial NARX models based on simulation error minimization",
    Int. J. Control 76 (2003) 1767-1781, doi:10.1080/00207170310001635419. Tests and exchanges are not from there.
    """

    max_terms: int = 15
    threshold: float | None = None
    level: float = 0.01
    significance: float | None = 0.01
    max_exchanges: int = 20

    def _check(self) -> None:
        whole_number(self.max_terms, "max_terms")
        whole_number(self.max_exchanges, "max_exchanges", 0)
        if self.threshold is not None and np.isnan(real_number(self.threshold, "threshold")):
            raise ModelError("threshold is nan; it must be a number, or None")
        if not 0 < real_number(self.level, "level") <= 0.5:
            raise ModelError(f"level = {self.level}; it must lie above 0 and not above 0.5")
        if self.significance is not None:
            probability(self.significance, "significance")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        data.require_samples_for(self.max_terms + 1)
        search, share = SempSearch(self, data), 0.0
        with self._keeping(lambda: search.path):
            while search.advance():
                share = max(share, min(len(search.chosen) / self.max_terms, 0.99))
                error = search.path[-1].msse ** 0.5
                progress(share, f"{len(search.chosen)} terms, free-run error {error:.4g} rms")
        if not search.path:
            raise ModelError("no candidate alone makes a model whose free run stays finite")
        least = min(step.msse for step in search.path)
        final = [step for step in search.path if step.msse <= _CLEARLY_WORSE * least][-1]
        kept = data.only([data.table.terms.index(term) for term in final.terms])
        found = least_squares(*kept.matrix())
        model = kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)
        steps, self.refined_ = list(search.path), False
        if self.max_exchanges and self.status_.ok and len(data.recordings[0].outputs) == 1 and not white(model, data):
            for larger in self._grown(model, data, search.sections, progress):
                steps.append(_grown_step(model, larger, data))
                model, self.refined_ = larger, True
        self.path_ = tuple(steps)
        self.srr_ = np.array([step.srr for step in steps])
        self.msse_ = np.array([step.msse for step in steps])
        self.terms_ = model.terms
        progress(1.0, f"{len(self.terms_)} terms")
        return model

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        """Return only the note on late inputs if the free run was fitted, which makes the one-step error larger."""
        refined = any(one.refined_ for one in self.equations_ or (self,))  # type: ignore[attr-defined]
        return late_inputs(self.model_, recordings) if refined else super()._notes(recordings)

    def _grown(
        self, model: NarxModel, data: Regression, sections: NDArray[np.int64], progress: Progress
    ) -> tuple[NarxModel, ...]:
        """Return the models of the growth; note an interrupt, which ends it early."""

        def tell(share: float, doing: str) -> None:
            try:
                progress(0.99, f"growing by the free-run error: {doing}")
            except KeyboardInterrupt:
                self.status_ = FitStatus.INTERRUPTED
                raise

        return grown(model, data, sections.tolist(), max_terms=self.max_terms, level=self.level, progress=tell)


def _grown_step(before: NarxModel, after: NarxModel, data: Regression) -> SempStep:
    """Return the step from a model to a refined one, which usually has one more term."""
    outputs = np.concatenate([r.outputs[0, data.first :] for r in data.recordings])
    power = float(np.mean((outputs - before.output_origin[0]) ** 2))
    old, new = (float(np.mean(np.concatenate(run_errors(model, data)) ** 2)) for model in (before, after))
    added = tuple(term for term in after.terms if term not in before.terms)
    return SempStep(added=added, pruned=(), terms=after.terms, srr=(old - new) / power, msse=new)
