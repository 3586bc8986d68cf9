"""Verification of several explanations, one after another, until one passes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import held_back_by, takes_most
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import verify


def first_that_stands(
    found: Iterable[Naming], problem: DiagnosisProblem, rng: np.random.Generator, started: Callable[[str], None]
) -> tuple[Naming, Verification, bool]:
    """Return the first explanation that passes verification, else the first one; its verification; whether it passed.

    The likeliest of `found` comes first, the last one may have none; `started` is called with the step as text.
    """
    # An explanation that was refuted in a rig variant is no alternative to the next one there. The same holds for the
    # remainder of an explanation if one of its effects is in doubt.
    verified: list[tuple[Naming, Verification, bool]] = []
    refuted: list[tuple[Calibration, frozenset[str]]] = []
    for naming in found:
        if verified:
            verified[0] = (verified[0][0].knowing(naming), *verified[0][1:])
            if naming.best is None:
                break
        started("verifying on held-out data")
        known = [effects for variant, effects in refuted if variant is naming.base.calibration]
        answer = naming.without(known)
        verification = verify(answer.base, answer.best or answer.base, rng, problem, answer.candidates)
        spared = _without_doubted(answer, verification, known)
        stands = verification.holds or bool(spared)
        verified.append((answer.as_likely(spared), verification, stands))
        if stands or answer.best is None:
            return verified[-1]
        refuted.append((answer.base.calibration, frozenset(answer.best.effects)))
        started("looking for another explanation")
    return verified[0]


def _without_doubted(
    naming: Naming, verification: Verification, refuted: Collection[frozenset[str]] = ()
) -> list[Candidate]:
    """Return the explanation without each effect in doubt; empty if one of these does not explain most by itself."""
    # It is also empty if one of these smaller explanations is unknown or was refuted. If the strength of an effect may be
    # zero, the explanation without it is possible whatever values a fit without it needs.
    if naming.best is None:
        return []
    known = {frozenset(c.effects): c for c in naming.candidates if not c.calibration.given_up}
    rest = {name: known.get(frozenset(naming.best.effects) - {name}) for name in verification.doubted}
    standing = [
        c
        for name, c in rest.items()
        if c is not None
        and frozenset(c.effects) not in refuted
        and (
            c in naming.alternatives
            or (takes_most(c, naming.base) and (name in verification.perhaps_absent or not held_back_by(c)))
        )
    ]
    return standing if len(standing) == len(rest) else []
