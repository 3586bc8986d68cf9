"""Pairs of which one effect counts for little: less than the plant's own error, or beside one that suffices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import TRIFLE, errs_by_its_law, gained, held_back_by, suffices
from deatwin.ident.mismatch.naming.decide import STRONG, Naming
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.tried import Names
from deatwin.ident.mismatch.naming.weigh import Scale

BARELY = 0.5
"""Share of the model error's power below which a second effect does not count; from 1 on it certainly does."""
BESIDE, TRIED = 3, 4
"""The likeliest single effects beside which others are looked for, since a promise to first order says the less the
farther a fit is from what is right; and the pairs that are tried, of those that promise to be likelier."""


def barely(search: Search) -> Naming:
    """The decision over pairs that explain the recordings, though one of the two counts for less than the floor.

    What is left without that one is too much for the plant's own error, and what it takes away too little to be
    certain of it: the other one alone stays an alternative.

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
    """The decision of a search, or where that is a single effect, one over pairs that are likelier by far.

    What suffices alone may imitate two. So the pairs that promise most beside all single effects that were fitted are
    tried, and weighed against these, whose laws may err.

    Parameters
    ----------
    search : Search
        With what was tried.
    naming : Naming
        Its decision.

    Returns
    -------
    Naming
        As it was, unless a pair is likelier: that one if it is so by far and explains the recordings, else with it as a
        alternative.
    """
    first = naming.best
    if first is None or len(first.effects) > 1:
        return naming
    elsewhere = [alternative for alternative in naming.alternatives if not search.is_own(alternative)]
    scale = Scale(problem=search.problem, base=search.tried[()], noise=search.noise)
    search.with_each(_promising(search, scale))
    best = max(odds := _odds(search, scale, first), key=odds.__getitem__, default=None)
    if best is not None and odds[best] > STRONG:
        search.fit_fewer(best)  # a fit given up, or rough, says little of one alone
        search.replacing(best, best)
        odds = _odds(search, scale, first)
    surely = [search.tried[names] for names, value in odds.items() if value > STRONG]
    found = search.decision([pair for pair in surely if pair.adequate and search.counts(pair)], lambda _: True)
    if found.best is not None:
        return found
    likelier = [search.tried[names] for names, value in odds.items() if value > 0.0]
    possible = sorted((pair for pair in likelier if search.is_possible(pair)), key=lambda pair: -scale.weight(pair))
    return _with_all(search, naming, first, elsewhere).as_likely(possible[:1])


def with_doubt(search: Search, naming: Naming) -> Naming:
    """A decision for a pair, with those of its effects and the likeliest one as alternatives that it is not far likelier than.

    Parameters
    ----------
    search : Search
        With what was tried.
    naming : Naming
        Its decision.

    Returns
    -------
    Naming
        Each of those as likely as the pair: what their laws miss is known no better. What takes too little alone for its
        law to be to blame for the rest is none.
    """
    pair = None if naming.best is None else search.tried.get(naming.best.effects)
    if pair is None or len(pair.effects) != 2:
        return naming
    scale = Scale(problem=search.problem, base=search.tried[()], noise=search.noise)
    alone = [c for names, c in search.tried.items() if len(names) == 1 and not c.calibration.given_up]
    possible = sorted((c for c in alone if search.is_possible(c)), key=lambda c: -scale.weight(c))
    possible = [c for c in possible if errs_by_its_law(c, search.tried[()])]
    asked = [c for k, c in enumerate(possible) if k == 0 or c.effects[0] in pair.effects]
    return naming.as_likely([c for c in asked if scale.of_two(pair, c) < STRONG])


def _promising(search: Search, scale: Scale) -> dict[Names, list[str]]:
    """Return, for each single effect, the others that make the likeliest pairs with it, to first order.

    A plant that was biased to imitate an effect, as a lag bends the damping, hides what that promises: so the nats count,
    too, by which the effect alone lets the rig's own parameters be nearer to their nominal values.
    """
    alone = [c for names, c in search.tried.items() if len(names) == 1 and not c.calibration.given_up]
    weights = {c.effects: scale.weight(c) for c in alone}
    highest, tried = max(weights.values(), default=0.0), {frozenset(names) for names in search.tried}
    biased = scale.biased(search.tried[()])
    relief = {names[0]: max(biased - scale.biased(c), 0.0) for names, c in search.tried.items() if len(names) == 1}
    alone = sorted(alone, key=lambda c: -weights[c.effects])[:BESIDE]
    promised = sorted(
        (
            (weights[c.effects] + odds + relief.get(other, 0.0) - highest, c.effects, other)
            for c in alone
            for other, odds in scale.promises(c, search.known()).items()
        ),
        key=lambda one: -one[0],
    )
    chosen: dict[frozenset[str], tuple[Names, str]] = {}
    for odds, names, other in promised:
        pair = frozenset((*names, other))
        if odds > 0.0 and pair not in tried and len(chosen) < TRIED:
            chosen.setdefault(pair, (names, other))
    found: dict[Names, list[str]] = {}
    for names, other in chosen.values():
        found.setdefault(names, []).append(other)
    return found


def _odds(search: Search, scale: Scale, first: Candidate) -> dict[Names, float]:
    """Log odds of each pair that was fitted over the likeliest of the first effect and its own two.

    Of these only what takes so much alone that its law may be to blame for the rest.
    """
    found: dict[Names, float] = {}
    for names, pair in list(search.tried.items()):
        if len(names) != 2 or pair.calibration.given_up:
            continue
        odds = scale.of_two(pair, search.tried[first.effects])
        if odds > 0.0:  # else it is not the likelier one, whatever its own two are: each of these may take a fit
            alone = [c for c in search.without_one(names) if errs_by_its_law(c, search.tried[()])]
            odds = min([odds, *(scale.of_two(pair, c) for c in alone if c.effects != first.effects)])
        found[names] = odds
    return found


def _with_all(search: Search, naming: Naming, first: Candidate, elsewhere: Sequence[Candidate]) -> Naming:
    """The same decision, with all that was tried since; its `first` one has a better fit by now, if that suffices.

    Alternatives `elsewhere` are of other variants of the plant, and not in this search.
    """
    tried = tuple(search.tried.values())
    now = {id(c.calibration): c for c in tried}
    alternatives = tuple(
        now.get(id(c.calibration), c) for c in naming.alternatives
    )  # those of other variants are not in this search
    again, before = search.tried[first.effects], now.get(id(first.calibration), first)
    best = again if suffices(again, search.tried[()]) and search.counts(again) else before
    return replace(naming, candidates=(*tried, *elsewhere), best=best, alternatives=alternatives, noise=search.noise)


def _each_takes(search: Search, names: Names, share: float) -> bool:
    """Return whether each effect of a set explains a share of the mismatch on both parts."""
    full, base = search.tried[names], search.tried[()]
    barely_counts = BARELY * search.error_power(names)
    return all(
        without.rms**2 - left.rms**2 >= max(barely_counts, share * (before.rms**2 - search.noise**2))
        for less in search.without_one(names)
        for without, left, before in (
            (less.fitted_test, full.fitted_test, base.fitted_test),
            (less.unseen_test, full.unseen_test, base.unseen_test),
        )
    )


def _doubted(search: Search, pairs: Sequence[Names]) -> Naming:
    """The decision over pairs; of the best one, what would do alone, but for less than the floor, stays an alternative."""
    naming = search.decision([search.tried[names] for names in pairs], lambda _: True)
    best = naming.best
    if best is None:
        return naming
    floor = search.error_power(best.effects)
    alone = [less for less in search.without_one(best.effects) if gained(best, less) < floor]
    return naming.as_likely([less for less in alone if not held_back_by(less)])
