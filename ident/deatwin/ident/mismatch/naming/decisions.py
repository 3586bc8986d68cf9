"""Answer of a search: the set of effects that explains the recordings, and its alternatives.

Sets that are adequate only within the uncertainty of the model error are considered last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import explained, is_near_model_error, suffices
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.decide import Naming, cannot_rule_out
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, likeliest
from deatwin.ident.mismatch.naming.limits import with_limits
from deatwin.ident.mismatch.naming.pairs import barely, with_doubt
from deatwin.ident.mismatch.naming.refit_all_data import judged_on_everything
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.tried import Names, once
from deatwin.ident.mismatch.thresholds import MOST, STRONG

_Decision = Callable[[Search, Sequence[Names]], Naming]
MOST_NEARLY = 2
"""Size of the largest set that may leave more than the model error: three effects can imitate almost anything."""


def decided(search: Search, stage: Sequence[Names]) -> Naming:
    """Decide among the adequate sets of a stage."""
    # A nearly adequate alternative becomes the best if it is far likelier: a set that is improbable beside it meets the
    # limit by luck.
    naming = _among(search, stage, lambda c: c.adequate and search.counts(c))
    if naming.best is None or len(naming.best.effects) > MOST_NEARLY:
        return naming
    enough = [c for c in naming.alternatives if _nearly_explains(search, c)]
    first = likeliest(enough or [naming.best])
    return naming.with_best(first) if advantage(first, naming.best) > STRONG else naming


def decided_surely(search: Search, stage: Sequence[Names]) -> Naming:
    """Decide among a stage, or among smaller sets if these are adequate when refitted from the best set's values."""
    return _surely(search, partial(_over_all, search, decided, stage), decided)


def of_two(search: Search) -> Naming:
    """Decide among pairs, even if a single effect is adequate."""
    search.with_one_more([names for names in search.tried if len(names) == 1])
    return _surely(search, lambda _: _over_pairs(search), _of_none)


def nearly(search: Search) -> Naming:
    """Decide among the smallest sets that are adequate within the uncertainty of the model error, or barely."""
    singles = [names for names in search.tried if len(names) == 1]
    search.broaden(singles)
    alone = _sufficing(search, singles)
    if alone.best is not None:
        return alone

    def over_pairs(_: Sequence[Names]) -> Naming:
        return _sufficing(search, [names for names in search.tried if len(names) == MOST_NEARLY])

    for decision in (over_pairs, lambda _: barely(search)):
        naming = _surely(search, decision, _sufficing)
        if naming.best is not None:
            return naming
    return alone


def settled(search: Search, stage: Sequence[Names]) -> Naming:
    """Decide among a stage by fits to all recordings, for sets that nearly explain the fitted data."""
    # Such a set must also remove most of the mismatch in the held-out data. A pair is rejected if one of its effects is
    # adequate alone.
    if all(len(names) == 1 for names in stage):
        return _settled(search, stage)
    return _surely(search, partial(_over_all, search, _settled, stage), _enough)


def on_everything(search: Search, naming: Naming) -> Iterator[Naming]:
    """Yield a decision with the alternatives that fits to all recordings restore, in each order of verification."""
    # Alternatives also include what the best candidate becomes at the limit of its range, and single effects whose law
    # error could do the work of a pair.
    judged = judged_on_everything(naming, search.problem, partial(search.may_return, naming))
    shown = shown_first(search, judged)
    for answer in (judged,) if shown is judged else (shown, judged):
        yield with_doubt(search, with_limits(answer, search.is_possible))


def shown_first(search: Search, naming: Naming) -> Naming:
    """Put a nearly adequate alternative first if the recordings show too little of the best candidate's cycle."""
    # Such a cycle can imitate any drift.
    everything = search.problem.everything
    if naming.best is None or shows_its_cycles(naming.best, everything):
        return naming
    shown = [c for c in naming.alternatives if search.is_own(c) and shows_its_cycles(c, everything)]
    enough = [c for c in shown if _nearly_explains(search, c)]
    if not enough:
        return naming
    first = likeliest(enough)
    led = naming.with_best(first)
    kept = {first.effects, *(alternative.effects for alternative in led.alternatives)}
    beside = [c for c in naming.candidates if c.effects in naming.probabilities and c.effects not in kept]
    near = [c for c in beside if search.is_own(c) and search.is_possible(c) and cannot_rule_out(c, first)]
    return replace(led, alternatives=(*led.alternatives, *near))


def _over_all(search: Search, over: _Decision, stage: Sequence[Names], further: Sequence[Names]) -> Naming:
    """Decide among a stage and `further` sets."""
    return over(search, once([*stage, *further]))


def _surely(search: Search, decision: Callable[[Sequence[Names]], Naming], over: _Decision) -> Naming:
    """Return a decision, or the decision among smaller sets if one of these explains the recordings."""
    # Earlier fits of smaller sets may be rough. So the best set is refitted without each of its effects, and the
    # decision is repeated. Effects that act like one of its own are tried in its place, and the decision is repeated
    # with them.
    further: list[Names] = []
    naming, sure = decision(further), set[Names]()
    while naming.best is not None and naming.best.effects not in sure:
        sure.add(naming.best.effects)
        fewer = search.fit_fewer(naming.best.effects)
        again = over(search, fewer)
        if again.best is not None and len(again.best.effects) > 1:
            surely = _surely(search, partial(_over_all, search, over, fewer), over)
            return again if surely.best is None else surely
        if again.best is not None:
            return again
        further += search.alike(naming.best.effects)
        naming = decision(further)
    return naming


def _of_none(search: Search, stage: Sequence[Names]) -> Naming:
    """Return no decision among smaller sets, because those were refuted."""
    return search.decision((), lambda candidate: False)


def _over_pairs(search: Search) -> Naming:
    naming = decided(search, _possible_pairs(search))
    return _sufficing(search, _possible_pairs(search)) if naming.best is None else naming


def _possible_pairs(search: Search) -> list[Names]:
    return [names for names, candidate in search.tried.items() if len(names) == 2 and search.is_possible(candidate)]


def _enough(search: Search, stage: Sequence[Names]) -> Naming:
    naming = _settled(search, stage)
    return _sufficing(search, stage) if naming.best is None else naming


def _settled(search: Search, stage: Sequence[Names]) -> Naming:
    sets = search.unpadded([names for names in stage if len(names) <= MOST_NEARLY])

    def hopeful(candidate: Candidate) -> bool:
        most = explained(candidate, search.tried[()]) > MOST
        return is_near_model_error(candidate.fitted_test) and most and search.counts(candidate)

    return search.settled([search.tried[names] for names in sets], hopeful)


def _sufficing(search: Search, stage: Sequence[Names]) -> Naming:
    return _among(search, stage, lambda c: _nearly_explains(search, c))


def _nearly_explains(search: Search, candidate: Candidate) -> bool:
    return suffices(candidate, search.tried[()]) and search.counts(candidate)


def _among(search: Search, stage: Sequence[Names], good: Callable[[Candidate], bool]) -> Naming:
    return search.decision([search.tried[names] for names in search.unpadded(stage)], good)
