"""Pairs in which one effect counts for little: for less than the model error, or beside one that explains nearly all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import TRIFLE, errs_by_its_law, gained, held_back_by, suffices
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.tried import Names
from deatwin.ident.mismatch.naming.weigh import Scale
from deatwin.ident.mismatch.thresholds import FEW, MOST, SEVERAL, STRONG


def barely(search: Search) -> Naming:
    """Decide among pairs that explain the recordings although one effect removes less than the model error."""
    # Without that effect the residual is too large, but its own share is too small to be certain. So the other effect
    # alone remains an alternative.
    pairs = [names for names, c in search.tried.items() if len(names) == 2 and c.adequate and search.counts(c)]
    return _doubted(search, [names for names in pairs if _each_takes(search, names, TRIFLE)])


def with_a_second(search: Search, naming: Naming) -> Naming:
    """Return the decision of a search, or a decision for a pair that is likelier than the best single effect.

    Beside an adequate single effect, a pair must be far likelier; otherwise the best of the likelier pairs becomes an
    alternative. A single effect that leaves more, but no more than an error of its law may, is not named, so any
    likelier pair is the better answer.
    """
    # An adequate single effect may imitate two. So the most promising pairs are fitted and compared with the single
    # effects, whose laws may be inexact.
    first = naming.best or _nearly_all(search)
    if first is None or len(first.effects) > 1:
        return naming
    alone = naming.best is not None
    least = STRONG if alone else 0.0
    elsewhere = [alternative for alternative in naming.alternatives if not search.is_own(alternative)]
    if not first.adequate:  # responses in the biased base plant do not rank what is left
        search.screen(first.effects)
    scale = search.scale
    search.with_each(_promising(search, scale))
    odds = _odds(search, scale, first)
    if (best := _likeliest(odds, 0.0)) is not None:
        search.fit_fewer(best)  # earlier fits of single effects may be rough
        odds = _odds(search, scale, first)
    if (best := _likeliest(odds, least)) is not None:
        search.replacing(best, best)
        odds = _odds(search, scale, first)
    surely = [search.tried[names] for names, value in odds.items() if value > least]
    enough = [pair for pair in surely if (pair.adequate if alone else suffices(pair, search.tried[()]))]
    found = search.decision([pair for pair in enough if search.counts(pair)], lambda _: True)
    if found.best is not None:
        return found
    if not alone:
        if (most := search.best_of([pair.effects for pair in _pairs(search)])) is not None:
            search.fit_fewer(most)  # an effect acts for certain only if the pair is far likelier than the other alone
        return replace(naming, candidates=tuple(search.tried.values()), noise=search.noise)
    likelier = [search.tried[names] for names, value in odds.items() if value > 0.0]
    possible = sorted((pair for pair in likelier if search.is_possible(pair)), key=lambda pair: -scale.weight(pair))
    return _with_all(search, naming, first, elsewhere).as_likely(possible[:1])


def _likeliest(odds: Mapping[Names, float], least: float) -> Names | None:
    """Return the pair with the largest odds if these exceed `least`, else None."""
    best = max(odds, key=odds.__getitem__, default=None)
    return best if best is not None and odds[best] > least else None


def _single_effects(search: Search) -> list[Candidate]:
    """Return the fits of single effects that were not given up."""
    return [c for names, c in search.tried.items() if len(names) == 1 and not c.calibration.given_up]


def _pairs(search: Search) -> list[Candidate]:
    """Return the fits of pairs that were not given up."""
    return [c for names, c in search.tried.items() if len(names) == 2 and not c.calibration.given_up]


def _nearly_all(search: Search) -> Candidate | None:
    """Return the likeliest single effect that leaves no more than an error of its law may, or None."""
    base = search.tried[()]
    possible = [c for c in _single_effects(search) if errs_by_its_law(c, base) and search.counts(c)]
    return max(possible, key=lambda c: c.evidence, default=None)


def with_doubt(search: Search, naming: Naming) -> Naming:
    """Add to a decision for a pair the single effects that are not far less likely than the pair."""
    # Each is as likely as the pair, because the errors of laws are not known better. Single effects that leave more
    # than an error of their law are not added.
    pair = None if naming.best is None else search.tried.get(naming.best.effects)
    if pair is None or len(pair.effects) != 2:
        return naming
    scale = search.scale
    possible = sorted(filter(search.is_possible, _single_effects(search)), key=lambda c: -scale.weight(c))
    possible = [c for c in possible if errs_by_its_law(c, search.tried[()])]
    asked = [c for k, c in enumerate(possible) if k == 0 or c.effects[0] in pair.effects]
    return naming.as_likely([c for c in asked if scale.of_two(pair, c, _pairs(search)) < STRONG])


def _promising(search: Search, scale: Scale) -> dict[Names, list[str]]:
    """Return, for each single effect, the others that make the likeliest pairs with it, to first order."""
    # A biased base fit hides the effect that it imitates, as a biased damping hides a lag. So an effect also gains the
    # nats by which it brings the rig's parameters nearer to their nominal values, unless the first effect has done so.
    # Predictions to first order are reliable only near a good fit, so second effects are sought beside few single ones.
    alone = _single_effects(search)
    weights = {c.effects: scale.weight(c) for c in alone}
    highest, tried = max(weights.values(), default=0.0), {frozenset(names) for names in search.tried}
    biased = scale.biased(search.tried[()])
    relief = {names[0]: max(biased - scale.biased(c), 0.0) for names, c in search.tried.items() if len(names) == 1}
    alone = sorted(alone, key=lambda c: -weights[c.effects])[:FEW]
    promised = sorted(
        (
            (weights[c.effects] + odds + min(relief.get(other, 0.0), scale.biased(c)) - highest, c.effects, other)
            for c in alone
            for other, odds in scale.promises(c, search.known(c.effects)).items()
        ),
        key=lambda one: -one[0],
    )
    chosen: dict[frozenset[str], tuple[Names, str]] = {}
    for odds, names, other in promised:
        pair = frozenset((*names, other))
        if odds > 0.0 and pair not in tried and len(chosen) < SEVERAL:
            chosen.setdefault(pair, (names, other))
    found: dict[Names, list[str]] = {}
    for names, other in chosen.values():
        found.setdefault(names, []).append(other)
    return found


def _odds(search: Search, scale: Scale, first: Candidate) -> dict[Names, float]:
    """Return the log odds of each fitted pair over the likeliest of `first` and the pair's own two effects."""
    # Its own effects count only if each leaves no more than an error of its law may.
    # Each pair is compared with the fits of all others, so any refits come first.
    # Of the others, a refit would hardly make one likely.
    before = _pairs(search)
    search.no_worse([p.effects for p in before if scale.of_two(p, search.tried[first.effects], before) > 0.0])
    found: dict[Names, float] = {}
    for pair in (others := _pairs(search)):
        odds = scale.of_two(pair, search.tried[first.effects], others)
        if odds > 0.0:  # otherwise fits of its effects, each of which costs time, would not make it likely
            alone = [c for c in search.without_one(pair.effects) if errs_by_its_law(c, search.tried[()])]
            odds = min([odds, *(scale.of_two(pair, c, others) for c in alone if c.effects != first.effects)])
        found[pair.effects] = odds
    return found


def _with_all(search: Search, naming: Naming, first: Candidate, elsewhere: Sequence[Candidate]) -> Naming:
    """Update a decision with all sets tried since, and with a better fit of `first` if that is adequate."""
    # The alternatives `elsewhere` belong to other rig variants, not to this search.
    tried = tuple(search.tried.values())
    now = {id(c.calibration): c for c in tried}
    alternatives = tuple(
        now.get(id(c.calibration), c) for c in naming.alternatives
    )  # those of other variants are not in this search
    again, before = search.tried[first.effects], now.get(id(first.calibration), first)
    best = again if suffices(again, search.tried[()]) and search.counts(again) else before
    return replace(naming, candidates=(*tried, *elsewhere), best=best, alternatives=alternatives, noise=search.noise)


def _each_takes(search: Search, names: Names, share: float) -> bool:
    """Return whether each effect of a set removes a share of the mismatch, in fitted and in held-out data."""
    full, base = search.tried[names], search.tried[()]
    barely_counts = MOST * search.error_power(names)  # an effect that removes more than all of it certainly counts
    return all(
        without.rms**2 - left.rms**2 >= max(barely_counts, share * (before.rms**2 - search.noise**2))
        for less in search.without_one(names)
        for without, left, before in (
            (less.fitted_test, full.fitted_test, base.fitted_test),
            (less.unseen_test, full.unseen_test, base.unseen_test),
        )
    )


def _doubted(search: Search, pairs: Sequence[Names]) -> Naming:
    """Decide among pairs; an effect of the best pair that alone leaves little more remains an alternative."""
    naming = search.decision([search.tried[names] for names in pairs], lambda _: True)
    best = naming.best
    if best is None:
        return naming
    floor = search.error_power(best.effects)
    alone = [less for less in search.without_one(best.effects) if gained(best, less) < floor]
    return naming.as_likely([less for less in alone if not held_back_by(less)])
