"""Two effects that mostly do the same: a third one, whose law lies between theirs, may do it alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.worth import gained

SHARED = 0.5
"""Share of what a pair explains, from which on the two are doubted: either alone explains so much of it."""


def have_most_in_common(pair: Candidate, alone: Sequence[Candidate], base: Candidate) -> bool:
    """Whether either of two effects alone explains half of what both do together.

    Parameters
    ----------
    pair : Candidate
        With both.
    alone : sequence of Candidate
        With each of them.
    base : Candidate
        With neither.

    Returns
    -------
    bool
    """
    return _in_common(pair, alone, base) >= SHARED * gained(pair, base)


def _in_common(pair: Candidate, alone: Sequence[Candidate], base: Candidate) -> float:
    """Mean square that either effect of a pair alone takes away; negative where one shows the other."""
    return sum(gained(single, base) for single in alone) - gained(pair, base)


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
    alone = [singles[name,] for name in best.effects if (name,) in singles]
    if len(alone) < len(best.effects) or not have_most_in_common(best, alone, naming.base):
        return naming
    common = _in_common(best, alone, naming.base)
    return naming.as_likely([c for c in singles.values() if gained(c, naming.base) >= common and possible(c)])
