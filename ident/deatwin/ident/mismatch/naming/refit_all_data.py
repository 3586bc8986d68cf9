"""Decision by fits to all recordings, for sets that failed on the held-out data only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import descend
from deatwin.ident.greybox.parts import Part, level_of
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import SUFFICIENT, asks, held_back_by, is_near_model_error, share_explained
from deatwin.ident.mismatch.naming.decide import Naming, cannot_rule_out, decide, is_as_likely, normalised
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, likeliest
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import MOST, NEGLIGIBLE, STRONG, TINY
from deatwin.ident.parallel import run_jobs

Refit = Callable[[Candidate, Sequence[Part]], Candidate | None]


def settled_on_everything(
    stage: Sequence[Candidate],
    tried: Sequence[Candidate],
    problem: DiagnosisProblem,
    hopeful: Callable[[Candidate], bool],
    possible: Callable[[Candidate], bool],
    refit: Refit | None = None,
) -> Naming:
    """Decide among a stage by fits to all recordings; without a best candidate if no `hopeful` one is adequate there.

    A `hopeful` candidate could be the answer, its held-out residual aside; `refit` returns None if a fit fails.
    """
    # If the law of a slow effect differs slightly from the catalogue's, its extrapolation to the held-out data may
    # exceed any limit, and a further effect would only correct the extrapolation. A far likelier candidate comes first
    # if it is adequate too and removes most of the mismatch in the held-out data. A single effect that fits the fitted
    # data equally well, and was excluded only for its extrapolation, is an alternative unless all recordings together
    # are strong evidence against it.
    noise = tried[0].noise
    known = {c.effects: c for c in stage if possible(c)}
    chosen = {c.effects for c in known.values() if hopeful(c)}
    if not chosen:
        return decide(tried, (), noise, hopeful, possible)
    # Beside a single effect whose extrapolation fails, a second one would only correct that extrapolation.
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
    # The distance of the two is known from fits to the fitted data only, whose extrapolation is inaccurate.
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
    """Add alternatives that are as likely as the best explanation if both are fitted to all recordings."""
    # If the law of a slow effect differs slightly from the catalogue's, the right effect may fail in the held-out data,
    # because the beginning of a relaxation does not determine its end. Candidates that lose on the fitted data are not
    # reconsidered. An added alternative comes first if it is likelier by the evidence of all recordings, adequate, and
    # removes most of the mismatch in the held-out data.
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
    # Candidates that were not refitted keep their odds against the best.
    known = _odds(whole.get(best.effects, first), first, leads=True)
    scale = known / max(naming.probabilities[best.effects], TINY)
    odds = {effects: scale * p for effects, p in naming.probabilities.items()}
    odds |= {w.effects: _odds(w, first, w in leading) for w in back}
    alternatives = (*naming.alternatives, *(competing[w.effects] for w in back))
    judged = replace(naming, alternatives=alternatives, probabilities=normalised(odds))
    return judged.with_best(competing[first.effects]) if leading else judged


def _odds(whole: Candidate, first: Candidate, leads: bool) -> float:
    """Return the odds of a fit to all data against the `first`, at most 1 if it may not come first."""
    against = advantage(whole, first)
    return float(np.exp(against if leads else min(against, 0.0)))


def _is_as_likely_there(alternative: Candidate, best: Candidate) -> bool:
    """Return whether the fitted data alone are no strong evidence against an alternative."""
    return is_as_likely(alternative.fitted_part, best.fitted_part)


def fitted_to_all(candidate: Candidate, parts: Sequence[Part]) -> Candidate | None:
    """Fit a candidate to all parts, so that none is held out; return None if the fit fails."""
    fit = descend(candidate.calibration.plant, parts, tolerance=NEGLIGIBLE)
    if not fit.status.ok:
        return None
    return replace(
        candidate,
        calibration=fit,
        unseen=np.zeros(0),
        sizes=tuple((part.size, 0) for part in parts),
        readings=tuple(part.reading for part in parts),
        measured=np.concatenate([part.measured for part in parts]),
        level=level_of(parts),
    )


def _settles(whole: Candidate, base: Candidate) -> bool:
    """Return whether a fit to all data is nearly adequate, held by no bound, and removes most of the mismatch."""
    most = share_explained(whole.fitted_test, base.fitted_test) > SUFFICIENT[0][0]
    return most and is_near_model_error(whole.fitted_test) and not held_back_by(whole)


def _holds(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a fit to the fitted part explains most of a mismatch in the held-out data."""
    before, after = base.unseen_test, candidate.unseen_test
    return not asks(after, before) or share_explained(after, before) > MOST
