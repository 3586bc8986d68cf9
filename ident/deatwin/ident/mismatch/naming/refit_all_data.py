"""All recordings together have the last word on what lost on the held-out part only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import descend
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import (
    MOST,
    SUFFICIENT,
    asks,
    held_back_by,
    is_near_model_error,
    share_explained,
)
from deatwin.ident.mismatch.naming.decide import STRONG, Naming, cannot_rule_out, decide, is_as_likely, normalised
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, likeliest
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import DECIDING
from deatwin.ident.parallel import run_jobs

TINY = 1e-300
"""Probability where there is none: thousands of nats may lie between explanations."""
Refit = Callable[[Candidate, Sequence[Part]], Candidate | None]


def settled_on_everything(
    stage: Sequence[Candidate],
    tried: Sequence[Candidate],
    problem: DiagnosisProblem,
    hopeful: Callable[[Candidate], bool],
    possible: Callable[[Candidate], bool],
    refit: Refit | None = None,
) -> Naming:
    """The decision over a stage by fits to all recordings.

    A slow effect whose law is not quite the catalogue's errs where it is extrapolated, by more than any limit bears,
    and a further effect would only mend the extrapolation.

    Parameters
    ----------
    stage : sequence of Candidate
        Those that compete: all with the same number of effects.
    tried : sequence of Candidate
        Everything so far, the base plant first.
    problem : DiagnosisProblem
        Recordings and number of workers.
    hopeful : callable
        Whether a candidate could be the answer, but for what it leaves of the held-out part.
    possible : callable
        Whether it could be an alternative.
    refit : callable, optional
        Fits a candidate to all parts; None of it where there is no fit.

    Returns
    -------
    Naming
        Without a best one where none leaves little enough of all recordings, or none is hopeful; led by what is
        likelier by far, if that leaves as little and takes most of the held-out part: else that part would refute it.
        A single effect that describes the fitted part as well, but is no possible alternative for its extrapolation, is one
        where all recordings have no strong evidence against it.
    """
    noise = tried[0].noise
    known = {c.effects: c for c in stage if possible(c)}
    chosen = {c.effects for c in known.values() if hopeful(c)}
    if not chosen:
        return decide(tried, (), noise, hopeful, possible)
    # Beside a single effect that strays, any second one would mend its tail, or do nothing.
    others = [c for c in stage if c.effects not in known and len(c.effects) == 1 and not held_back_by(c)]
    strayed = {c.effects: c for c in others if is_near_model_error(c.fitted_test)}
    competing = [(c, problem.everything) for c in (tried[0], *known.values(), *strayed.values())]
    base, *found = run_jobs(refit or fitted_to_all, competing, workers=problem.jobs)
    if base is None:
        return decide(tried, (), noise, hopeful, possible)
    fitted = [whole for whole in found if whole is not None]
    wholes = [whole for whole in fitted if whole.effects in known]
    enough = [whole for whole in wholes if _settles(whole, base)]
    answers = [whole for whole in enough if whole.effects in chosen]
    naming = decide(tried, wholes, noise, lambda whole: whole in answers, lambda whole: True)
    if naming.best is None:
        return naming
    holding = [whole for whole in enough if _holds(known[whole.effects], tried[0])]
    first = likeliest(holding or [naming.best])
    lead = first if advantage(first, naming.best) > STRONG else naming.best
    led, best = naming.with_best(lead), known[lead.effects]
    # How far apart the two are is known of fits to the fitted part only, which err where they are extrapolated.
    near = [w for w in answers if w not in (lead, *led.alternatives) and cannot_rule_out(w, lead)]
    back = [
        w
        for w in fitted
        if w.effects in strayed and is_as_likely(w, lead) and _is_as_likely_there(strayed[w.effects], best)
    ]
    odds = {w.effects: _odds(w, lead, w in holding) for w in (*wholes, *back)}
    alternatives = (*(known[c.effects] for c in (*led.alternatives, *near)), *(strayed[w.effects] for w in back))
    return replace(led, best=best, alternatives=alternatives, probabilities=normalised(odds))


def judged_on_everything(
    naming: Naming, problem: DiagnosisProblem, possible: Callable[[Candidate], bool], refit: Refit | None = None
) -> Naming:
    """Also keep as alternatives the explanations that hold as well as the best when both are fitted to all recordings.

    The held-out part is extrapolated. A slow effect whose law is not quite the catalogue's errs there although it is the
    right one, since no fit to the beginning of a relaxation knows its end; what describes the beginning worse cannot
    be the truth for the luck that it had at the end. What loses on the fitted part has lost.

    Parameters
    ----------
    naming : Naming
        Decided by both parts.
    problem : DiagnosisProblem
        Recordings and number of workers.
    possible : callable
        Whether a candidate could be an alternative.
    refit : callable, optional
        As for `settled_on_everything`.

    Returns
    -------
    Naming
        With probabilities by the evidence of all recordings, where any alternative was brought back; led by one of those if
        it is the likelier, leaves no more than noise and model error, and takes most of the held-out part.
    """
    best = naming.best
    if best is None:
        return naming
    kept = {best.effects, *(alternative.effects for alternative in naming.alternatives)}
    doubtful = [
        c
        for c in naming.candidates
        if c.effects in naming.probabilities and c.effects not in kept and possible(c) and _is_as_likely_there(c, best)
    ]
    if not doubtful:
        return naming
    competing = {c.effects: c for c in (best, *doubtful)}
    fits = run_jobs(refit or fitted_to_all, [(c, problem.everything) for c in competing.values()], workers=problem.jobs)
    whole = {c.effects: c for c in fits if c is not None}
    leading = [whole[best.effects]] if best.effects in whole else []
    back = [whole[c.effects] for c in doubtful if c.effects in whole]
    back = [w for w in back if not leading or is_as_likely(w, leading[0])]
    if not back:
        return naming
    if leading:  # a fit that failed is no evidence against the best
        leading += [
            w for w in back if w.fitted_test.within_error and _holds(competing[w.effects], naming.candidates[0])
        ]
    first = likeliest(leading or back)
    # What was not fitted again keeps its odds against the best.
    known = _odds(whole.get(best.effects, first), first, leads=True)
    scale = known / max(naming.probabilities[best.effects], TINY)
    odds = {effects: scale * p for effects, p in naming.probabilities.items()}
    odds |= {w.effects: _odds(w, first, w in leading) for w in back}
    alternatives = (*naming.alternatives, *(competing[w.effects] for w in back))
    judged = replace(naming, alternatives=alternatives, probabilities=normalised(odds))
    return judged.with_best(competing[first.effects]) if leading else judged


def _odds(whole: Candidate, first: Candidate, leads: bool) -> float:
    """Return the odds of a fit to everything against the `first`; it is at most as likely if it may not lead."""
    against = advantage(whole, first)
    return float(np.exp(against if leads else min(against, 0.0)))


def _is_as_likely_there(alternative: Candidate, best: Candidate) -> bool:
    """Return whether the fitted part alone has no strong evidence against an alternative."""
    return is_as_likely(_of_the_fitted_part(alternative), _of_the_fitted_part(best))


def _of_the_fitted_part(candidate: Candidate) -> Candidate:
    size = candidate.calibration.residuals.size
    sizes = tuple((fitted, 0) for fitted, _ in candidate.sizes)
    return replace(
        candidate, unseen=np.zeros(0), sizes=sizes, measured=candidate.measured[:size], level=candidate.level[:size]
    )


def fitted_to_all(candidate: Candidate, parts: Sequence[Part]) -> Candidate | None:
    """A candidate fitted to all parts, of which nothing is unseen; None where there is no fit."""
    fit = descend(candidate.calibration.plant, parts, tolerance=DECIDING)
    if not fit.status.ok:
        return None
    return replace(
        candidate,
        calibration=fit,
        unseen=np.zeros(0),
        sizes=tuple((part.size, 0) for part in parts),
        measured=np.concatenate([part.measured for part in parts]),
    )


def _settles(whole: Candidate, base: Candidate) -> bool:
    """Whether a fit to everything takes away most of what the base plant leaves, fitted so, and is near the floor.

    In a plant within its ranges.
    """
    most = share_explained(whole.fitted_test, base.fitted_test) > SUFFICIENT[0][0]
    return most and is_near_model_error(whole.fitted_test) and not held_back_by(whole)


def _holds(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a fit to the fitted part explains most of a mismatch in the held-out data."""
    before, after = base.unseen_test, candidate.unseen_test
    return not asks(after, before) or share_explained(after, before) > MOST
