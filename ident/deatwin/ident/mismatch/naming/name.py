"""Search for missing physics: add effects to the plant, one after another, until the mismatch is explained."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming, cannot_rule_out, is_as_likely
from deatwin.ident.mismatch.naming.decisions import decided, decided_surely, nearly, of_two, on_everything, settled
from deatwin.ident.mismatch.naming.pairs import with_a_second
from deatwin.ident.mismatch.naming.screen import LinearisedResponse
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.trial import Fitted
from deatwin.ident.mismatch.naming.tried import Finished, Names
from deatwin.ident.mismatch.naming.variants import in_variant, with_fewer
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import CLEARLY_LESS
from deatwin.plant.resolution import solved_like

MOST_CAUSES = 3
"""Largest number of effects in an explanation; larger sets cannot be distinguished."""
_InVariant = tuple[Search, list[Names], Naming]
"""Search in one rig variant, the single effects tried there, and the decision among them."""


@checks_its_arguments
def name_causes(
    problem: DiagnosisProblem,
    base: Candidate,
    known: Sequence[LinearisedResponse],
    alternatives: Sequence[Candidate] = (),
    finished: Finished | None = None,
    fitted: Fitted | None = None,
) -> Naming:
    """Search for the smallest set of effects that explains the recordings.

    1. Each promising effect is added alone to the base plant. If there are other interpretations of the rig file,
       single effects are also added to the base plant in these interpretations.
    2. If no single effect is adequate, further effects are added to the best one, up to three in all, and the most
       promising pairs are tried. If no second effect improves the fit, the search continues from the next best effect.
    3. If one effect is adequate, a second effect is added only if it explains a part of the mismatch that the first
       does not explain.
    4. If the search in another interpretation of the rig file fails, it is repeated in the interpretation that the file
       states.
    5. An effect is removed from a set if another interpretation makes it unnecessary. If nothing explains the mismatch,
       the best pair is also tried in the other interpretations.

    After each addition, other effects are tried in place of each earlier one, because the best single effect may merely
    imitate two others.

    Parameters
    ----------
    problem : DiagnosisProblem
        Effects and recordings.
    base : Candidate
        The calibrated base plant.
    known : sequence of LinearisedResponse
        Linearised responses of all effects in the base plant.
    alternatives : sequence of Candidate
        The base plant in other interpretations of the rig file.
    finished : callable, optional
        Called with the completed share, from 0 to 1.
    fitted : callable, optional
        Called twice for each fit. The first call, after the fit, has the calibration and None as arguments. The second
        has the calibration and its held-out residuals, ndarray of shape (n,), SI.

    Returns
    -------
    Naming
        Candidates and the choice among them. The first candidate is the base plant in the chosen interpretation.
    """
    return next(explanations(problem, base, known, alternatives, finished, fitted))


def explanations(
    problem: DiagnosisProblem,
    base: Candidate,
    known: Sequence[LinearisedResponse],
    alternatives: Sequence[Candidate] = (),
    finished: Finished | None = None,
    fitted: Fitted | None = None,
) -> Iterator[Naming]:
    """Yield the answer of `name_causes`, then a second answer in case verification refutes the first.

    Each is yielded in two orders if its best effect shows too little of its cycle. The last one has no best candidate
    if nothing else explains the recordings.
    """
    # An adequate single effect ends the search, but it may have imitated two effects; then the second answer is a pair.
    # If fewer effects were adequate in another rig variant, the second answer is the larger set in the first variant.

    def tell(number: int, share: float) -> None:
        if finished is not None:
            finished((number + share) / MOST_CAUSES)

    search = Search(problem, base, known, fitted)
    stage = search.beside((), partial(tell, 0))
    if finer := search.more_finely(stage):
        base, *alternatives = (variant.solved_like(finer) for variant in (base, *alternatives))
        problem = replace(problem, nominal=solved_like(problem.nominal, finer))
        search = Search(problem, base, known, fitted)
        stage = search.beside((), lambda share: tell(0, 1.0))  # a share that is told does not fall
    search.judge_by_the_best(stage)
    naming = decided(search, stage)
    own = taken = search, stage, naming
    misread = [alternative for alternative in alternatives if search.may_be_misread(stage, naming, alternative)]
    if misread:
        taken = _best_variant([own, *(_decided_in_variant(search, alternative, stage) for alternative in misread)])
    search, naming = _with_more(taken, own, tell)
    fit = search.tried[()].calibration
    others = [variant for variant in (base, *alternatives) if variant.calibration is not fit]
    naming = with_a_second(search, naming)
    simplest, first = with_fewer(search, naming, others)
    yield from _final(simplest, first)
    if simplest is not search and naming.best is not None:
        yield from _final(search, naming)
    elif first.best is not None and len(first.best.effects) == 1:
        yield from _final(simplest, of_two(simplest))


def _final(search: Search, naming: Naming) -> Iterator[Naming]:
    return (replace(answer, failed=tuple(search.failed)) for answer in on_everything(search, naming))


def _decided_in_variant(search: Search, alternative: Candidate, stage: Sequence[Names]) -> _InVariant:
    other, found = in_variant(search, alternative, stage)
    return other, found, decided(other, found)


def _with_more(taken: _InVariant, own: _InVariant, tell: Callable[[int, float], None]) -> tuple[Search, Naming]:
    """Return the decision among the smallest explaining sets, in the variant `taken` or in the rig file's `own`."""
    # A wrong variant may replace one of two effects, but not the other. So a smaller set in the file's own variant is
    # preferred to a larger one in `taken`. A single effect that is adequate in the file's own variant only is rejected,
    # because the other variant does the same.
    ways = [(taken[0], _one_after_another(*taken, tell))]
    if own[0] is not taken[0] and own[0].one_takes_most(own[1]):
        ways.append((own[0], _one_after_another(*own, lambda number, share: None)))
    last = taken[2]
    while ways:
        for way in list(ways):
            search, decisions = way
            naming = next(decisions, None)
            alone = naming is not None and naming.best is not None and len(naming.best.effects) == 1
            if naming is None or (alone and search is not taken[0]):
                ways.remove(way)
            elif naming.best is not None:
                return search, naming
            elif search is taken[0]:
                last = naming
    return taken[0], last


def _one_after_another(
    search: Search, stage: list[Names], naming: Naming, tell: Callable[[int, float], None]
) -> Iterator[Naming]:
    """Yield the decision among single effects (`naming`), among larger sets, and last among nearly adequate sets."""
    # `tell` is called with the number of added effects and the finished share of that stage.
    for number in range(1, MOST_CAUSES):
        yield settled(search, stage) if naming.best is None else naming
        stage = search.with_one_more(stage, partial(tell, number))
        if not stage:
            break
        naming = decided_surely(search, stage)
        yield naming
    yield nearly(search)


def _best_variant(variants: Sequence[_InVariant]) -> _InVariant:
    """Return the rig variant in which the search continues."""
    # The search continues in the variant with the likeliest adequate effect. If no effect is adequate, it continues in
    # the variant in which an effect leaves clearly less than in the first; else in one that leaves, without effects,
    # hardly more than the first variant does with an effect; else in the first. The rig file's own variant is given up
    # only for strong evidence, and for the same effects only if the model error could not have caused the difference.
    # Adequate effects of other variants that cannot be ruled out are kept as alternatives.
    sufficing = [(naming.best, k) for k, (_, _, naming) in enumerate(variants) if naming.best is not None]
    if not sufficing:
        least = [search.least(stage) for search, stage, _ in variants]
        lowest = int(np.argmin(least))
        if least[lowest] < CLEARLY_LESS * least[0]:
            return variants[lowest]
        missing = [search.missing([()]) for search, _, _ in variants]
        simplest = int(np.argmin(missing))
        return variants[simplest if CLEARLY_LESS * missing[simplest] < variants[0][0].missing(variants[0][1]) else 0]
    best, number = max(sufficing, key=lambda pair: pair[0].evidence)
    first, k = sufficing[0]
    may_lead = cannot_rule_out if first.effects == best.effects else is_as_likely
    if k == 0 and may_lead(first, best):
        best, number = first, 0
    search, stage, naming = variants[number]
    elsewhere = [c for _, _, n in variants if n is not naming and n.best is not None for c in (n.best, *n.alternatives)]
    seen = {best.effects, *(alternative.effects for alternative in naming.alternatives)}
    further = [c for c in elsewhere if c.effects not in seen and cannot_rule_out(c, best)]
    return search, stage, naming.beside(further)
