"""Next sets of a search: a further effect added to a set, or another effect in the place of one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import first_only, reading_times
from deatwin.ident.greybox.tangent import linearised_rms
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.onsets import event_leads
from deatwin.ident.mismatch.naming.screen import Lead, LinearisedResponse, leads, linearised_responses, most_promising
from deatwin.ident.mismatch.naming.shortlist import shortlist
from deatwin.ident.mismatch.naming.siblings import siblings
from deatwin.ident.mismatch.naming.trial import NEAR, Fitted, Trial, trials_of, unbiased_like
from deatwin.ident.mismatch.naming.tried import CLEARLY_BETTER, Finished, Names, Tried, each_without_one, once
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect

BESIDE = 6
"""Effects that are tried beside others."""
ALONE = 3
"""Number of effects tried alone that are added to others whatever their score."""


class Search(Tried):
    """A search in one variant of the plant: what it has tried, and what promises most of all that it has not.

    Parameters
    ----------
    problem : DiagnosisProblem
        Effects and recordings.
    base : Candidate
        Without further effects.
    known : sequence of LinearisedResponse or None
        Of all effects in the base plant; None to simulate them once they are asked for.
    fitted : callable or None
        Called with each fit.
    """

    def __init__(
        self,
        problem: DiagnosisProblem,
        base: Candidate,
        known: Sequence[LinearisedResponse] | None,
        fitted: Fitted | None = None,
    ) -> None:
        super().__init__(problem, base, fitted)
        self.leads: dict[str, Lead] = {}
        self._known = known
        self._gone_on: set[Names] = set()
        self._replaced: dict[tuple[Names, Names], Calibration] = {}
        self._events: dict[Names, tuple[Calibration, tuple[Lead, ...]]] = {}
        self.unscreened = [] if known is None else self._not_in(known)

    def in_variant_of(self, base: Candidate) -> Search:
        """A search in another variant of the plant, `base`, where nothing was tried yet."""
        other = Search(self.problem, base, None, self.fitted)
        other.unscreened = [name for name in self.unscreened if (name,) not in self.tried]
        return other

    def known(self) -> Sequence[LinearisedResponse]:
        """Linearised responses of all effects in the base plant of this variant: those of another variant say little of it."""
        if self._known is None:
            fit = self.tried[()].calibration
            self._known = linearised_responses(self.problem, fit, self.problem.effects, fit)
            self.unscreened = self._not_in(self._known)
        return self._known

    def _not_in(self, known: Sequence[LinearisedResponse]) -> list[str]:
        seen = {response.effect.name for response in known}
        return [e.name for e in self.problem.effects if e.name not in seen]

    def with_one_more(self, stage: Sequence[Names], finished: Finished | None = None) -> list[Names]:
        """Sets of one more effect beside the best of a `stage`, and in its place; none where none helps.

        Of two also those that promise most together. `finished` is called with the share that is done.
        """
        beside = self._beside_one(stage, finished)
        together = [] if any(len(names) > 1 for names in stage) else self._together()
        return once([*beside, *together])

    def _beside_one(self, stage: Sequence[Names], finished: Finished | None) -> list[Names]:
        """Return the same from one set of a `stage` after another, until a further effect helps.

        Beside what leaves a trifle none could count. But it may only imitate two others: then the best of those that
        leave more is gone on with, and beside a single one where nothing helps, the next best. Two that do not take
        most of the mismatch are no beginning of three.
        """
        found: list[Names] = []
        for before in self._beginnings(stage):
            beside = self.beside(before, finished)
            found += beside
            finished = None  # nobody knew of a second beginning
            best = self.best_that_counts(beside)
            if best is not None:
                return found + self.replacing(before, best)
        return []  # a further effect does not help: another one beside it would not be understood

    def _together(self) -> list[Names]:
        """The pairs that promise most together, if one of them counts; and what else may be in the best one's place."""
        together = self._new(joint_trials(self))
        best = self.best_that_counts(together)
        if best is None:
            return []
        return together + (self.replacing(best, best) if self.is_best_of_its_size(best) else [])

    def _beginnings(self, stage: Sequence[Names]) -> list[Names]:
        """The sets of a `stage` beside which a further effect is looked for, in their order.

        A cycle of which the recordings show little imitates any drift: it comes after all others.
        """
        ranked = self.ranked([names for names in stage if not self.leaves_a_trifle(names)])
        ranked.sort(key=lambda names: not shows_its_cycles(self.tried[names], self.problem.everything))
        if any(len(names) > 1 for names in ranked):
            return [names for names in ranked[:1] if self.takes_most(names)]
        return [*ranked[:1], *(names for names in ranked[1:2] if self.takes_most(names))]

    def beside(self, names: Names, finished: Finished | None = None) -> list[Names]:
        """Try each promising effect beside those of `names`; `finished` is called with the share that is done."""
        self._gone_on.add(names)
        fit = self.tried[names].calibration
        unbiased = unbiased_like(self.problem, fit.plant)
        found = self._leads(names, self.problem.effects)
        # What did well alone did it with another residual: of this one it promises nothing.
        alone = [replace(lead, share=0.0) for lead in self._good_alone(names)]
        promising = (*alone, *found[:BESIDE]) if names else shortlist(self.problem, unbiased, found)
        chosen = {lead.effect.name: lead for lead in promising}
        self.leads = chosen | self.leads
        stage = self._new(trials_of(unbiased, fit, chosen.values()), finished)
        best = self.best_of(stage)
        return stage if best is None else once([*stage, *self._siblings(names, best)])

    def with_each(self, chosen: Mapping[Names, Collection[str]]) -> list[Names]:
        """Try some effects beside each of several sets, where that was not done."""
        trials: list[Trial] = []
        for names, others in chosen.items():
            fit = self.tried[names].calibration
            found = self._leads(names, [effect for effect in self.problem.effects if effect.name in others])
            trials += trials_of(unbiased_like(self.problem, fit.plant), fit, found)
        return self._new(trials)

    def _siblings(self, names: Names, best: Names) -> list[Names]:
        """Try beside `names` what acts as the rest of the set `best` does, unless that is not the best of its size.

        Once for each fit of that. What is returned are the sets that were not known, or of which a better fit is known
        by now.
        """
        found, fit = self.tried[best].calibration, self.tried[names].calibration
        done = self._replaced.get((best, names)) is found
        if done or not self.takes_most(best) or not self.is_best_of_its_size(best):
            return []
        self._replaced[best, names] = found
        added = tuple(name for name in best if name not in names)
        alike = siblings(self.problem, found, added, self._open_beside(names, best))
        bare, unbiased = found.plant.without_effects(*added), fit.plant
        trials = [
            Trial(start=bare.with_effects(lead.estimate), biased=unbiased.with_effects(lead.effect), without=fit)
            for lead in alike
        ]
        better = self.attempt(trials, alternative=found.rms)
        seen = {name for new in better for name in new}
        self.leads = self.leads | {lead.effect.name: lead for lead in alike if lead.effect.name in seen}
        return better

    def _open_beside(self, names: Names, best: Names) -> list[Effect]:
        """Effects that were not tried beside `names`, or have a time or a period and left clearly more than `best`.

        A time or a period is looked for in a residual, and what began in another one may not have found it.
        """
        least, floor = self.missing([best]), self.error_power(best)

        def is_open(effect: Effect) -> bool:
            tried = tuple(sorted((*names, effect.name)))
            if tried not in self.tried:
                return True
            timed = bool(effect.event) or effect.cycle(()) > 0.0
            return timed and least + floor < CLEARLY_BETTER * (self.missing([tried]) + floor)

        rest, full = self.tried[names].calibration.plant, self.tried[best].calibration.plant
        # What the set has at one place may be at another one, or may be what another effect does at a further place.
        others = [effect for effect in self.problem.everywhere if rest.lacks(effect)]
        return [effect for effect in others if effect.name not in full.effect_names and is_open(effect)]

    def _new(self, trials: Sequence[Trial], finished: Finished | None = None) -> list[Names]:
        """Try what was not tried, against the best of the sets of as many effects."""
        new = [t for t in trials if self.names_of(t) not in self.tried]
        size = len(self.names_of(new[0])) if new else 0
        return self.attempt(new, finished, self.least_rms([names for names in self.tried if len(names) == size]))

    def _good_alone(self, names: Names) -> list[Lead]:
        """Return what explained most by itself: the score is blind to what the plant is still biased to imitate."""
        alone = [single for single in self.tried if len(single) == 1 and single[0] not in names]
        return [self.leads[single[0]] for single in self.ranked(alone)[:ALONE] if single[0] in self.leads]

    def replacing(self, before: Names, best: Names) -> list[Names]:
        """Try the `best` set of a stage with each effect that was there `before` the stage replaced by others.

        What comes in the place of one may do better beside others than the rest of the best set: if a better one is
        found so, its effects are replaced in turn.
        """
        found = self._in_place_of(before, best)
        evidence = self.tried[best].evidence
        better = self.best_that_counts([names for names in found if self.tried[names].evidence > evidence])
        return found if better is None else found + self._in_place_of(better, better)

    def _in_place_of(self, several: Names, full: Names) -> list[Names]:
        """Try what may be in the place of each of `several` effects of the set `full`, unless that was done."""
        found: list[Names] = []
        for old, rest in zip(full, each_without_one(full), strict=True):
            if old not in several:
                continue
            is_known = rest in self.tried and not self.tried[rest].calibration.given_up
            if not is_known:
                self.fit_some(full, rest)
            if rest in self.tried:
                found += [] if is_known and rest in self._gone_on else self.beside(rest)
                found += self._siblings(rest, full)
        return found

    def alike(self, full: Names) -> list[Names]:
        """Try what acts as each of several effects of the set `full` in the place of it, unless that was done."""
        rests = [rest for rest in each_without_one(full) if rest and rest in self.tried]
        return once([new for rest in rests for new in self._siblings(rest, full)])

    def _leads(self, names: Names, further: Sequence[Effect]) -> tuple[Lead, ...]:
        """Return what each of some `further` effects could explain of what a candidate leaves."""
        asked = {effect.name for effect in further}
        events = self.event_leads(names) if any(effect.event for effect in further) else []
        found = most_promising(self._screened(names, further), *events)
        return tuple(lead for lead in found if lead.effect.name in asked)

    def _screened(self, names: Names, further: Sequence[Effect]) -> tuple[Lead, ...]:
        """Return the same as far as the fit itself tells."""
        fit, base = self.tried[names].calibration, self.tried[()].calibration
        if not names:
            return leads(self.known(), fit)
        free = [effect for effect in further if fit.plant.lacks(effect)]
        times = reading_times(base.plant, first_only(self.problem.fitted))
        looking = [effect for effect in free if effect.starts(times, fit.residuals[: times.size])]
        again = linearised_responses(self.problem, base, looking, fit)
        others = {e.name for e in free} - {e.name for e in looking}
        return leads([*(f for f in self.known() if f.effect.name in others), *again], fit)

    def event_leads(self, *several: Names) -> list[tuple[Lead, ...]]:
        """Return what each event could explain beside each of `several` candidates fitted before it."""
        fits = {names: self.tried[names].calibration for names in several}
        new = [names for names, fit in fits.items() if names not in self._events or self._events[names][0] is not fit]
        effects, parts = self.problem.effects, self.problem.fitted
        jobs = [(unbiased_like(self.problem, fits[names].plant), fits[names], effects, parts) for names in new]
        found = run_jobs(event_leads, jobs, workers=self.problem.jobs)
        self._events |= {names: (fits[names], events) for names, events in zip(new, found, strict=True)}
        return [self._events[names][1] for names in several]


FIRST = 3
"""Number of the most promising untried pairs that are tried."""


def joint_trials(search: Search) -> list[Trial]:
    """Trials of the pairs that promise most of all in which one effect was tried alone.

    A step from the best single effect to a second one beside it misses two that work against each other: either alone
    explains little, and what explains more may imitate both. What a second effect could explain of what each single one
    leaves, to first order, costs no simulation, but for when an event came.

    Parameters
    ----------
    search : Search
        In which single effects were tried.

    Returns
    -------
    list of Trial
        Of pairs that were not tried the most promising, the first one first, as far as they promise nearly as much as
        the best possible pair that was tried has kept.
    """
    given = frozenset(search.problem.nominal.effect_names)
    tried = {frozenset(names) | given for names in search.tried}
    kept = [names for names, c in search.tried.items() if len(names) == 2 and search.is_possible(c)]
    least = (NEAR * search.least_rms(kept)) ** 2
    promising: dict[frozenset[str], Trial] = {}
    for left, trial in sorted(_of_all(search), key=lambda found: found[0]):
        names = frozenset(trial.start.effect_names)
        if left < least and names not in tried:
            promising.setdefault(names, trial)
    return list(promising.values())[:FIRST]


def _of_all(search: Search) -> Iterator[tuple[float, Trial]]:
    """Each trial with the mean square that it leaves to first order, wherever its parameters had to go for that.

    Many single fits were given up before their minimum, and what their own parameters would still take is not to be
    had by a second effect. An event is seen from another plant, all of whose parameters may move: what it leaves there
    counts no more than what its share takes off here.
    """
    singles = [names for names in search.tried if len(names) == 1]
    for names, events in zip(singles, search.event_leads(*singles), strict=True):
        fit = search.tried[names].calibration
        free = [f for f in search.known() if fit.plant.lacks(f.effect)]
        found = most_promising(leads(free, fit), events)
        alone = linearised_rms(fit.residuals, fit.movable) ** 2
        for lead, trial in zip(found, trials_of(unbiased_like(search.problem, fit.plant), fit, found), strict=True):
            yield max(lead.left, alone - lead.share * fit.rms**2), trial
