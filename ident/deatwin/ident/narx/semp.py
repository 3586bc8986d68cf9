"""Simulation-error minimisation with pruning (SEMP): terms are judged by the free run of the model they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, real_number, whole_number
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.growth import grown, run_errors, white
from deatwin.ident.narx.identifier import CandidateSearch, FitStatus, Progress
from deatwin.ident.narx.late_inputs import late_inputs
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.semp_search import SempSearch, SempStep
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

# A free run that fails in a single section passes every test over the sections. Whatever they say, the final model's
# mean squared error is therefore at most this multiple of the smallest of the path: a choice, far beyond chance.
_CLEARLY_WORSE = 2.0


@dataclass(kw_only=True, eq=False, repr=False)
class Semp(CandidateSearch):
    """Choose terms by simulation-error minimisation with pruning (SEMP).

    In every step each candidate x is added to the model M on trial, the parameters are estimated by least squares, and
    the free run of the enlarged model is simulated. The candidate with the largest simulation error reduction ratio,
    ``SRR = (MSSE(M) - MSSE(M + x)) / mean(y^2)`` with the mean squared simulation error MSSE, is added. Terms are then
    pruned as long as the pruned model has a smaller simulation error than the model before the addition.

    If the record is noisy, a false term among many candidates often lowers the simulation error more than the true
    term. Two tests are therefore added to the published rules; ``level=0.5, significance=None``
    switches them off:

    - Simulation errors are compared by a paired t test on the sums over about twenty sections of the records.
      Differences that are not significant at ``level`` are ignored. Of the candidates that are not significantly worse
      than the best, the one that lowers the one-step error most is added, provided that it does not worsen the free
      run.
    - A term is a candidate only if it lowers the one-step error significantly (F test at ``significance`` divided by
      the number of candidates); a term is pruned when it no longer lowers this error significantly and the free run
      without it is no worse.

    Additions end when no candidate is left, at ``max_terms``, or when the SRR is below ``threshold``. Two further steps
    follow, which are not part of the published method either; ``max_exchanges=0`` switches them off. A term is
    exchanged for a candidate that improves the free run, or that lowers the one-step error without worsening the free
    run. The search also continues once from the model of a forward regression (`Frols`) with the smallest simulation
    error, if that error is below the error of the present model, because adding single terms may miss a resonance, for
    example. The result is the model of the last step whose mean squared simulation error is at most twice the smallest
    one: a test over sections cannot detect an error that is large in only a few sections.

    Least squares and the F test are valid for white one-step errors. If these are not white, for example because of
    noise on the readings, the model is extended (single output only, and not with ``max_exchanges=0``): its parameters
    are refined to the smallest free-run error, and terms are added by that error up to ``max_terms``. The result is the
    first model on this path such that it and all later models are not significantly worse than the best one on held-out
    sections.

    Parameters
    ----------
    output_lags, input_lags, degree, functions, rule
        Candidate terms, as in `Frols`.
    max_terms : int
        Largest number of terms.
    threshold : float, optional
        Smallest SRR of an addition, as published, dimensionless; if omitted, the tests alone decide.
    level : float
        One-sided level of the test between simulation errors, above 0; at 0.5 every difference is significant.
    significance : float, optional
        Probability, per step, that some false candidate is added to a true model; None switches the test off.
    max_exchanges : int
        Largest number of exchanges when no addition is left; 0 gives the published search alone.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units; ``theta_cov`` is ``sigma^2 (P'P)^-1`` with the residual variance
        sigma^2 and the regressors P or, if the model was extended, that of `refine`.
    terms_ : tuple of Term
        Terms of the model.
    path_ : tuple of SempStep
        Steps of the search.
    refined_ : bool
        True if the parameters were refined to the smallest free-run error; with several outputs, this attribute and all
        that follow belong to each estimator in ``equations_``.
    srr_ : ndarray, shape (n_steps,)
        Simulation error reduction ratio of each step before pruning, dimensionless.
    msse_ : ndarray, shape (n_steps,)
        Mean squared simulation error after each step, square of the output's unit.

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
