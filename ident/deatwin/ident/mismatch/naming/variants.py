"""Effects in other rig variants: another interpretation of the rig file costs less than missing physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import suffices, takes_most
from deatwin.ident.mismatch.naming.decide import Naming, cannot_rule_out, is_as_likely
from deatwin.ident.mismatch.naming.decisions import decided, decided_surely, nearly
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.trial import Trial, trials_of, with_fitted
from deatwin.ident.mismatch.naming.tried import Names, each_without_one
from deatwin.ident.mismatch.thresholds import SEVERAL


def in_variant(search: Search, alternative: Candidate, stage: Sequence[Names]) -> tuple[Search, list[Names]]:
    """Begin a search in another rig variant with the best single effects of this one; return it and those effects."""
    # If the other variant leaves clearly less, it is the likelier one, and all effects are searched there.
    fit, other = alternative.calibration, search.in_variant_of(alternative)
    found = other.beside(()) if search.is_clearly_worse_than(alternative) else []
    unbiased = search.problem.nominal.with_rig(fit.plant.rig)
    # The score of an effect holds for its own variant only.
    again = {n: replace(search.leads[n], share=0.0) for names in search.ranked(stage)[:SEVERAL] for n in names}
    new = [lead for name, lead in again.items() if (name,) not in other.tried and name not in other.lost]
    other.leads = again | other.leads
    found += other.attempt(
        trials_of(unbiased, fit, new), alternative=min(search.least_rms(stage), other.least_rms(found))
    )
    other.judge_by_the_best(found)
    return other, found


def with_fewer(search: Search, naming: Naming, variants: Sequence[Candidate]) -> tuple[Search, Naming]:
    """Return a search and its answer, or those in another rig variant that needs one effect less."""
    # A reading that is taken one sample early looks like a delay, beside any other effect. So an effect may be replaced
    # by another variant. If there is no answer, the best pair is tried in the other variants, because two effects may
    # explain the recordings only there. What a variant leaves without effects says little if there is an answer,
    # because either base fit may be biased.
    decision = _explained if naming.best is None else _in_its_place
    full, answers = _several(search, naming), []
    for variant in variants if full else ():
        leaves_more = search.is_clearly_better_than(variant)
        if naming.best is None and leaves_more:
            continue
        other, found = decision(search, full, variant)
        # In a variant that leaves clearly more without effects, any set removes most; so it must be as likely.
        comes_near = is_as_likely if leaves_more else cannot_rule_out
        if found.best is None or not _explains(found.best, search):
            continue
        if naming.best is None or comes_near(found.best, naming.best):
            answers.append((found.best.evidence, other, found))
    return max(answers, key=lambda answer: answer[0], default=(0.0, search, naming))[1:]


def _several(search: Search, naming: Naming) -> list[Names]:
    """Return the explanations of several effects, the best first; without any, the best pair and the best three."""
    if naming.best is None:
        best = [search.best_of([names for names in search.tried if len(names) == number]) for number in (2, 3)]
        return [names for names in best if names is not None]
    found = [candidate.effects for candidate in (naming.best, *naming.alternatives)]
    return [names for names in found if len(names) > 1] if len(found[0]) > 1 else []


def _explains(answer: Candidate, search: Search) -> bool:
    """Return whether an answer in another variant explains the mismatch of this one."""
    return takes_most(answer, search.tried[()]) and suffices(answer, search.tried[()])


def _in_its_place(search: Search, full: Sequence[Names], variant: Candidate) -> tuple[Search, Naming]:
    """Drop one effect from each set, refit in another variant, and decide among these."""
    other = _begun(search, variant)
    trials = {rest: _trial(search, names, variant, rest) for names in full for rest in each_without_one(names)}
    other.judge_by_the_best(other.attempt(list(trials.values()), alternative=search.tried[full[0]].calibration.rms))
    return other, nearly(other)


def _explained(search: Search, full: Sequence[Names], variant: Candidate) -> tuple[Search, Naming]:
    """Decide in another variant among a pair and its effects, then among pairs out of three effects."""
    # `full` holds the pair first. Used if this variant has no answer.
    pair, *threes = full
    other, rms = _begun(search, variant), search.tried[pair].calibration.rms
    singles = other.attempt([_trial(search, pair, variant, rest) for rest in each_without_one(pair)], alternative=rms)
    other.judge_by_the_best(singles)
    naming = decided(other, singles)
    if naming.best is not None:
        return other, naming
    pairs = other.attempt([_trial(search, pair, variant, pair)], alternative=rms)
    other.judge_by_the_best([*singles, *pairs])
    naming = decided_surely(other, pairs)
    if naming.best is not None or not threes:
        return other, naming
    left = {rest: three for three in threes for rest in each_without_one(three) if rest != pair}
    pairs += other.attempt([_trial(search, three, variant, rest) for rest, three in left.items()], alternative=rms)
    other.judge_by_the_best([*singles, *pairs])
    return other, decided_surely(other, pairs)


def _begun(search: Search, variant: Candidate) -> Search:
    """Begin a search in another variant, with the smaller of both noise estimates."""
    other = search.in_variant_of(replace(variant, noise=min(variant.noise, search.noise)))
    other.leads = dict(search.leads)
    return other


def _trial(search: Search, full: Names, variant: Candidate, names: Names) -> Trial:
    """Build effects of a set that is fitted in one variant into another one, with their fitted values."""
    plant, fit = search.plant_of(full, names), variant.calibration
    unbiased = search.problem.nominal.with_rig(fit.plant.rig)
    return Trial(start=with_fitted(unbiased, plant), biased=with_fitted(fit.plant, plant), without=fit)
