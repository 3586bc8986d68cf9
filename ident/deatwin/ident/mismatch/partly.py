"""Partial explanations: effects that explain nearly all of a mismatch, and the remainder."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.excess import beyond_noise, excess_of
from deatwin.ident.mismatch.locate.location import Location
from deatwin.ident.mismatch.located import Unexplained
from deatwin.ident.mismatch.model_error import perhaps_absent, with_own_errors
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.clocks import of_one_clock
from deatwin.ident.mismatch.naming.criteria import acts, explained, held_back_by, share_explained, takes_most
from deatwin.ident.mismatch.naming.decide import Naming, decide
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, advantage_of_shape
from deatwin.ident.mismatch.naming.limits import with_limits
from deatwin.ident.mismatch.naming.tried import each_without_one
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import NEARLY_ALL, STRONG
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import verify


def acting(naming: Naming, problem: DiagnosisProblem, rng: np.random.Generator) -> tuple[Naming, Verification] | None:
    """Return the effects that certainly act although they do not explain all of a mismatch, and their verification.

    None if no effect certainly acts: a strength may be 0, or two drifts with one time constant may be one mechanism.
    """
    if naming.best is not None and of_one_clock(naming.best):
        return None
    found = led_by_what_acts(naming)
    if found is None or found.best is None or (naming.best and set(naming.best.effects) == set(found.best.effects)):
        return None
    fit = with_own_errors(found.best.calibration, problem, found.best.noise)
    if perhaps_absent(fit, found.best.effects):
        return None
    verification = verify(found.base, found.best, rng, problem, found.candidates)
    return (found, verification) if verification.holds else None


def explains_all(best: Candidate, base: Candidate, whole: Calibration | None) -> bool:
    """Return whether an explanation leaves no more than noise, model error and errors of its laws."""
    # The fit to all recordings, if known, counts instead of that to the fitted part.
    error = best.fitted_test.model_error
    residuals = (best.calibration if whole is None else whole).residuals
    left, before = (excess_of(r, best.noise, error) for r in (residuals, base.residuals))
    return best.adequate or left.within_error or share_explained(left, before) >= NEARLY_ALL


def led_by_what_acts(naming: Naming) -> Naming | None:
    """Return the smallest set that removes nearly all of a mismatch, or the effects it shares with equally likely sets.

    It has no alternatives; None if no set removes so much, or equally likely sets have no effect in common.
    """
    base, tried = naming.base, naming.candidates
    known = {c.effects: c for c in tried}
    for size in sorted({len(c.effects) for c in tried} - {0}):
        stage = [c for c in tried if len(c.effects) == size]
        led = decide(tried, stage, naming.noise, lambda c: _leads(c, base, known), lambda c: takes_most(c, base))
        first = led.best
        if first is None:
            continue
        led = with_limits(led, lambda c: takes_most(c, base))
        larger = [c for c in tried if len(c.effects) > size and _takes_nearly_all(c, base)]
        beyond = [c for c in larger if advantage(c, first) > STRONG]
        # No set explains everything, so some law is inexact, and sets that differ by no more than that are as likely.
        close = [c for c in stage if takes_most(c, base) and advantage_of_shape(first, c) <= STRONG]
        common = set(first.effects).intersection(*(c.effects for c in (*led.alternatives, *beyond, *close)))
        best = known.get(tuple(sorted(common)))
        if not common or best is None or not _stands_alone(best, base):
            return None
        return replace(led, best=best, alternatives=(), failed=naming.failed)
    return None


def _takes_nearly_all(candidate: Candidate, base: Candidate) -> bool:
    return explained(candidate, base) >= NEARLY_ALL and _stands_alone(candidate, base)


def _stands_alone(candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate's own effects remove most of the mismatch, in a plant within its ranges."""
    return takes_most(candidate, base) and acts(candidate, base) and not held_back_by(candidate)


def _leads(candidate: Candidate, base: Candidate, known: dict[tuple[str, ...], Candidate]) -> bool:
    """Return whether a candidate explains nearly all of the mismatch and needs each of its effects."""
    if not _takes_nearly_all(candidate, base):
        return False
    fewer = [known.get(rest) for rest in each_without_one(candidate.effects)]
    return all(rest is not None and advantage(candidate, rest) > STRONG for rest in fewer)


def unexplained(answer: Candidate, base: Candidate, left: Location, seconds: float) -> Unexplained:
    """Return the remainder of a mismatch in the reported unit, and where most of it is; `seconds` is the total time."""
    found, size = left.summary, left.unit[1]
    before, after = (beyond_noise(float(c.losses.mean()), answer.noise) for c in (base, answer))
    windows = [w for w in found.time if w.to_s - w.from_s < NEARLY_ALL * seconds]
    return Unexplained(
        rms=after / size,
        mismatch=before / size,
        share=min((after / before) ** 2, 1.0) if before > 0.0 else 0.0,
        fitted=answer.fitted_test.size / size,
        unseen=answer.unseen_test.size / size,
        time=max(windows, key=lambda w: w.score, default=None),
        frequency=max(found.frequency, key=attrgetter("power"), default=None),
        region=next(iter(found.region), None),
        place=next((p.place for p in sorted(found.place, key=lambda p: -p.score) if p.score > 0.0), None),
    )
