"""Two effects that mostly do the same: a third one, whose law lies between theirs, may do it alone."""

from __future__ import annotations

from collections.abc import Callable

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.worth import gained

__all__ = ["with_overlap"]

SHARED = 0.5
"""Share of what a pair explains, from which on the two are doubted: either alone explains so much of it."""


def with_overlap(naming: Naming, possible: Callable[[Candidate], bool]) -> Naming:
    """Also keep as rivals the single effects that explain all that the two of a pair have in common.

    Creep and a drift, of which either would explain nearly everything, add up to the curve of many a slow mechanism
    that no catalogue describes to the last digit. That one and not two is missing is then as good an answer.

    Parameters
    ----------
    naming : Naming
        Decided.
    possible : callable
        Whether a candidate could be a rival.

    Returns
    -------
    Naming
        With each of those as likely as the pair: evidence does not compare laws that are not known.
    """
    best = naming.best
    if best is None or len(best.effects) != 2:
        return naming
    singles = {c.effects: c for c in naming.candidates if len(c.effects) == 1 and not c.calibration.given_up}
    alone = [singles.get((name,)) for name in best.effects]
    if any(c is None for c in alone):
        return naming
    whole = gained(best, naming.base)
    common = sum(gained(c, naming.base) for c in alone if c is not None) - whole
    if common < SHARED * whole:
        return naming
    return naming.as_likely([c for c in singles.values() if gained(c, naming.base) >= common and possible(c)])
