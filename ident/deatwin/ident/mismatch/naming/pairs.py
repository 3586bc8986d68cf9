"""Pairs of which one effect counts for little: less than the plant's own error, or beside one that suffices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deatwin.ident.mismatch.naming.decide import STRONG, Naming
from deatwin.ident.mismatch.naming.worth import TRIFLE, gained, takes_most

if TYPE_CHECKING:
    from deatwin.ident.mismatch.naming.sets import Names, Search

__all__ = ["barely", "with_a_second"]

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
    return _doubted(search, [names for names in pairs if _each_counts_barely(search, names)])


def with_a_second(search: Search, naming: Naming) -> Naming:
    """The decision of a search, or where that is a single effect, one over pairs whose second has a part of its own.

    What suffices alone may leave as much as nobody knows the plant's own error by, and a second effect may be in that:
    one that takes a share of the mismatch which no term that the law of the first may lack would.

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
    beside = [names for names in search.beside(first.effects) if _is_of_two(search, names)]
    best = search.best_of(beside)
    if best is None:
        return naming
    others = [names for names in search.replacing(first.effects, best) if _is_of_two(search, names)]
    found = _doubted(search, list(dict.fromkeys((*beside, *others))))
    likelier = found.best is not None and found.best.evidence - first.evidence > STRONG
    return found if likelier else naming


def _leaves_room(search: Search, names: Names) -> bool:
    """Whether what an explanation leaves beyond the noise is enough for a second effect that counts."""
    left = float(search.tried[names].losses.mean()) - search.noise**2
    return left >= max(BARELY * search.floor_power(names), TENTH * search.mismatch_power)


def _is_of_two(search: Search, names: Names) -> bool:
    """Whether a pair explains the recordings, and each of the two does what the law of the other may not lack.

    Where each of them takes most of the mismatch alone, both do mostly the same, and together they bend their law.
    """
    pair = search.tried[names]
    if not (pair.adequate and search.counts(pair) and _each_counts_barely(search, names)):
        return False
    alone = list(search.without_one(names))
    apart = not all(takes_most(less, search.tried[()]) for less in alone)
    return apart and all(gained(pair, less) >= TENTH * search.mismatch_power for less in alone)


def _each_counts_barely(search: Search, names: Names) -> bool:
    """Whether each effect of a pair counts for half of the floor on the fitted and on the unseen part: none is luck."""
    full = search.tried[names]
    least = max(BARELY * search.floor_power(names), TRIFLE * search.mismatch_power)
    return all(
        min(less.fitted_test.rms**2 - full.fitted_test.rms**2, less.unseen_test.rms**2 - full.unseen_test.rms**2)
        >= least
        for less in search.without_one(names)
    )


def _doubted(search: Search, pairs: Sequence[Names]) -> Naming:
    """The decision over pairs; of the best one, what would do alone, but for less than the floor, stays a rival."""
    naming = search.decision([search.tried[names] for names in pairs], lambda _: True)
    best = naming.best
    if best is None:
        return naming
    floor = search.floor_power(best.effects)
    return naming.as_likely([less for less in search.without_one(best.effects) if gained(best, less) < floor])
