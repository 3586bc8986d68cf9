"""Pairs of which one effect counts for little: less than the plant's own error, or beside one that suffices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import STRONG, Naming
from deatwin.ident.mismatch.naming.overlap import have_most_in_common
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.tried import Names
from deatwin.ident.mismatch.naming.worth import TRIFLE, gained, held_back_by, suffices

BARELY = 0.5
"""Of the model error's power: a second effect that counts for less is none, and for certain one from the whole on."""
TENTH = 0.1
"""Of the mismatch's energy: no mechanism's law is known to the last term, and a second effect that takes less beside
one that suffices mends the law of that one."""


def barely(search: Search) -> Naming:
    """The decision over pairs that explain the recordings, though one of the two counts for less than the floor.

    What is left without that one is too much for the plant's own error, and what it takes away too little to be
    certain of it: the other one alone stays a rival.

    Parameters
    ----------
    search : Search
        With what was tried.

    Returns
    -------
    Naming
    """
    pairs = [names for names, c in search.tried.items() if len(names) == 2 and c.adequate and search.counts(c)]
    return _doubted(search, [names for names in pairs if _each_takes(search, names, TRIFLE)])


def with_a_second(search: Search, naming: Naming) -> Naming:
    """The decision of a search, or where that is a single effect, one over pairs whose second has a part of its own.

    What suffices alone may leave as much as nobody knows the plant's own error by, and a second effect may be in that:
    one that takes a share of the mismatch which no term that the law of the first may lack would, on the fitted and on
    the unseen part, for the tail of a slow effect is mended by anything.

    Parameters
    ----------
    search : Search
        With what was tried.
    naming : Naming
        Its decision.

    Returns
    -------
    Naming
        As it was, unless a pair explains the recordings that is likelier by far; where its second effect counts for
        less than the floor, the first one alone stays a rival.
    """
    first = naming.best
    if first is None or len(first.effects) > 1 or not _leaves_room(search, first.effects):
        return naming
    search.beside(first.effects)
    best = search.best_of(_of_two(search, first.effects))
    if best is None:
        return _with_all(search, naming, first)
    search.fit_fewer(best)
    search.replacing(first.effects, best)
    found = _doubted(search, _of_two(search))
    if found.best is not None and found.best.effects != best:  # a fit given up, or rough, says little of one alone
        search.fit_fewer(found.best.effects)
        found = _doubted(search, _of_two(search))
    alone = search.tried[first.effects].evidence
    likelier = found.best is not None and found.best.evidence - alone > STRONG
    return found if likelier else _with_all(search, naming, first)


def _with_all(search: Search, naming: Naming, first: Candidate) -> Naming:
    """The same decision, with all that was tried since; its `first` one has a better fit by now, if that suffices."""
    tried = tuple(search.tried.values())
    now = {id(c.calibration): c for c in tried}
    rivals = tuple(now.get(id(c.calibration), c) for c in naming.rivals)  # those of other forms are not in this search
    again, before = search.tried[first.effects], now.get(id(first.calibration), first)
    best = again if suffices(again, search.tried[()]) and search.counts(again) else before
    return replace(naming, candidates=tried, best=best, rivals=rivals, noise=search.noise)


def _leaves_room(search: Search, names: Names) -> bool:
    """Whether what an explanation leaves is more than the floor on a part, and enough for a second effect on both.

    That it is not certainly more does not count: the unseen part is short, and what is missing there may be slow.
    """
    left, base = search.tried[names], search.tried[()]
    within_floor = left.fitted_test.within_floor and left.unseen_test.within_floor
    return not within_floor and all(
        after.size**2 >= max(BARELY * search.floor_power(names), TENTH * before.size**2)
        for after, before in ((left.fitted_test, base.fitted_test), (left.unseen_test, base.unseen_test))
    )


def _of_two(search: Search, first: Names = ()) -> list[Names]:
    """The pairs of two things that were tried, some before one was found to do; those with the `first` effects."""
    pairs = [names for names in search.tried if len(names) == 2 and {*first} <= {*names}]
    return [names for names in pairs if _is_of_two(search, names)]


def _is_of_two(search: Search, names: Names) -> bool:
    """Whether a pair explains the recordings, and each of the two does what the law of the other may not lack.

    Where they have most of it in common, both do mostly the same, and together they bend their law.
    """
    pair, base = search.tried[names], search.tried[()]
    if not (pair.adequate and search.counts(pair) and _each_takes(search, names, TENTH)):
        return False
    alone = list(search.without_one(names))
    return len(alone) == len(names) and not have_most_in_common(pair, alone, base)


def _each_takes(search: Search, names: Names, share: float) -> bool:
    """Whether each effect of a set takes a share of the mismatch, and barely counts, on both parts: none is luck."""
    full, base = search.tried[names], search.tried[()]
    barely_counts = BARELY * search.floor_power(names)
    return all(
        without.rms**2 - left.rms**2 >= max(barely_counts, share * (before.rms**2 - search.noise**2))
        for less in search.without_one(names)
        for without, left, before in (
            (less.fitted_test, full.fitted_test, base.fitted_test),
            (less.unseen_test, full.unseen_test, base.unseen_test),
        )
    )


def _doubted(search: Search, pairs: Sequence[Names]) -> Naming:
    """The decision over pairs; of the best one, what would do alone, but for less than the floor, stays a rival."""
    naming = search.decision([search.tried[names] for names in pairs], lambda _: True)
    best = naming.best
    if best is None:
        return naming
    floor = search.floor_power(best.effects)
    alone = [less for less in search.without_one(best.effects) if gained(best, less) < floor]
    return naming.as_likely([less for less in alone if not held_back_by(less)])
