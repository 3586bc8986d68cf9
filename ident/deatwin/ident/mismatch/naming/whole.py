"""Rivals that lost on the unseen part only: all recordings together have the last word on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, calibrate
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.excess import excess_over_floor
from deatwin.ident.mismatch.losses import block_losses, evidence
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import STRONG, Naming, normalised
from deatwin.ident.mismatch.refit.search import DECIDING
from deatwin.ident.parallel import run_jobs

__all__ = ["judged_on_everything"]


def judged_on_everything(naming: Naming, bench: Bench, possible: Callable[[Candidate], bool]) -> Naming:
    """Also keep as rivals the explanations that hold as well as the best when both are fitted to all recordings.

    The unseen part is extrapolated. A slow effect whose law is not quite the catalogue's errs there although it is the
    right one, since no fit to the beginning of a relaxation knows its end; what describes the beginning worse cannot
    be the truth for the luck that it had at the end. What loses on the fitted part has lost.

    Parameters
    ----------
    naming : Naming
        Decided by both parts.
    bench : Bench
        Recordings and number of workers.
    possible : callable
        Whether a candidate could be a rival.

    Returns
    -------
    Naming
        With probabilities by the evidence of all recordings, where any rival was brought back; led by one of those if
        it is the likelier and leaves no more than noise and model error.
    """
    best = naming.best
    if best is None:
        return naming
    kept = {best.effects, *(rival.effects for rival in naming.rivals)}
    doubtful = [
        c for c in naming.candidates
        if c.effects in naming.probabilities and c.effects not in kept and possible(c)
        and _evidence(best.calibration) - _evidence(c.calibration) < STRONG
    ]  # fmt: skip
    if not doubtful:
        return naming
    whole = run_jobs(_on_everything, [(c, bench.everything) for c in (best, *doubtful)], workers=bench.jobs)
    of_best = whole[0]
    back = [w for w in whole[1:] if of_best.evidence - w.evidence < STRONG]
    if not back:
        return naming
    weights, known = dict(naming.probabilities), naming.probabilities[best.effects]
    weights |= {w.candidate.effects: known * float(np.exp(w.evidence - of_best.evidence)) for w in back}
    first = max((of_best, *(w for w in back if w.adequate)), key=lambda w: w.evidence).candidate
    rivals = (*naming.rivals, *(w.candidate for w in back))
    found = replace(naming, rivals=rivals, probabilities=normalised(weights))
    return found.led_by(first)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Whole:
    """A candidate that was fitted to everything."""

    candidate: Candidate
    evidence: float
    adequate: bool


def _on_everything(candidate: Candidate, parts: Sequence[Part]) -> _Whole:
    """What a fit to all parts leaves; that of nothing where there is none."""
    fit = calibrate(candidate.calibration.plant, parts, tolerance=DECIDING)
    if not fit.status.ok:
        return _Whole(candidate=candidate, evidence=-np.inf, adequate=False)
    left = excess_over_floor(fit.residuals, candidate.noise, fit.plant.rig.model_error)
    return _Whole(candidate=candidate, evidence=_evidence(fit), adequate=left.within_floor)


def _evidence(fit: Calibration) -> float:
    """Its logarithm, on what was fitted alone."""
    return evidence(block_losses(fit.residuals), len(fit.names))
