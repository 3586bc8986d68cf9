"""Next sets of a search: a further effect is added to a set, or one effect is replaced by another."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.tangent import linearised_rms
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.onsets import event_leads
from deatwin.ident.mismatch.naming.screen import (
    Lead,
    LinearisedResponse,
    by_effect,
    leads,
    linearised_responses,
    most_promising,
    sought_in,
)
from deatwin.ident.mismatch.naming.shortlist import shortlist
from deatwin.ident.mismatch.naming.siblings import siblings
from deatwin.ident.mismatch.naming.trial import NEAR, Fitted, Trial, trials_of, unbiased_like
from deatwin.ident.mismatch.naming.tried import Finished, Names, Tried, each_without_one, once
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import CLEARLY_LESS, FEW, MANY
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect


class Search(Tried):
    """Search in one rig variant: the sets tried so far, and the most promising ones not yet tried."""

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
        self._own: dict[Names, tuple[Calibration, Sequence[LinearisedResponse]]] = {}
        self._gone_on: set[Names] = set()
        self._replaced: dict[tuple[Names, Names], Calibration] = {}
        self._responses: dict[str, list[LinearisedResponse]] = {}
        self._events: dict[Names, tuple[Calibration, tuple[Lead, ...]]] = {}
        self.unscreened = [] if known is None else self._not_in(known)

    def in_variant_of(self, base: Candidate) -> Search:
        """Return an empty search in another rig variant, with the calibrated plant `base`."""
        other = Search(self.problem, base, None, self.fitted)
        other.unscreened = [name for name in self.unscreened if (name,) not in self.tried]
        return other

    def known(self, names: Names = ()) -> Sequence[LinearisedResponse]:
        """Return the linearised responses of all effects in the plant of a set if it was screened, else in the base plant
        of this variant.
        """
        own = self._own.get(names)
        if own is not None and own[0] is self.tried[names].calibration:
            return own[1]
        if self._known is None:
            fit = self.tried[()].calibration
            self._known = linearised_responses(self.problem, fit, self.problem.effects, fit)
            self.unscreened = self._not_in(self._known)
        return self._known

    def screen(self, names: Names) -> None:
        """Compute the linearised responses of all further effects in the plant of a set."""
        # Those in the base plant are poor if the set moves the plant far from it, but each of the new ones takes a
        # plant of its own to be compiled.
        fit = self.tried[names].calibration
        free = [effect for effect in self.problem.effects if fit.plant.lacks(effect)]
        self._own[names] = fit, linearised_responses(self.problem, fit, free, fit)

    def _not_in(self, known: Sequence[LinearisedResponse]) -> list[str]:
        seen = {response.effect.name for response in known}
        return [e.name for e in self.problem.effects if e.name not in seen]

    def with_one_more(self, stage: Sequence[Names], finished: Finished | None = None) -> list[Names]:
        """Try sets with one more effect than the best of a `stage`, with its effects replaced, and the best pairs."""
        # The list is empty if no further effect helps.
        beside = self._beside_one(stage, finished)
        together = [] if any(len(names) > 1 for names in stage) else self._together()
        return once([*beside, *together])

    def _beside_one(self, stage: Sequence[Names], finished: Finished | None) -> list[Names]:
        """Try further effects beside one set of a `stage` after another, until one helps."""
        # Beside a set that leaves almost nothing no effect could count, but such a set may imitate two others; so the
        # search continues from the best set that leaves more, and for single effects also from the next best. A pair is
        # extended only if it removes most of the mismatch.
        found: list[Names] = []
        for before in self._beginnings(stage):
            beside = self.beside(before, finished)
            found += beside
            finished = None  # progress beside a second set is not known beforehand
            best = self.best_that_counts(beside)
            if best is not None:
                return found + self.replacing(before, best)
        return []

    def _together(self) -> list[Names]:
        """Try the most promising pairs, and replacements of the best one; return nothing if none of them counts."""
        together = self._new(joint_trials(self))
        best = self.best_that_counts(together)
        if best is None:
            return []
        return together + (self.replacing(best, best) if self.is_best_of_its_size(best) else [])

    def _beginnings(self, stage: Sequence[Names]) -> list[Names]:
        """Return the sets of a `stage` beside which further effects are tried, in order."""
        # A cycle that the recordings hardly show can imitate any drift, so it comes last.
        ranked = self.ranked([names for names in stage if not self.leaves_a_trifle(names)])
        ranked.sort(key=lambda names: not shows_its_cycles(self.tried[names], self.problem.everything))
        if any(len(names) > 1 for names in ranked):
            return [names for names in ranked[:1] if self.takes_most(names)]
        return [*ranked[:1], *(names for names in ranked[1:2] if self.takes_most(names))]

    def beside(self, names: Names, finished: Finished | None = None) -> list[Names]:
        """Try each promising effect beside those of `names`; `finished` is called with the share of the work done."""
        self._gone_on.add(names)
        fit = self.tried[names].calibration
        unbiased = unbiased_like(self.problem, fit.plant)
        found = self._leads(names, self.problem.effects)
        # The score of a single effect belongs to another residual, so it promises nothing for this one.
        alone = [replace(lead, share=0.0) for lead in self._good_alone(names)]
        promising = (*alone, *found[:MANY]) if names else shortlist(self.problem, unbiased, found)
        chosen = {lead.effect.name: lead for lead in promising}
        self.leads = chosen | self.leads
        stage = self._new(trials_of(unbiased, fit, chosen.values()), finished)
        best = self.best_of(stage)
        return stage if best is None else once([*stage, *self._siblings(names, best)])

    def with_each(self, chosen: Mapping[Names, Collection[str]]) -> list[Names]:
        """Try the given effects beside each of several sets, unless that was done."""
        trials: list[Trial] = []
        for names, others in chosen.items():
            fit = self.tried[names].calibration
            found = self._leads(names, [effect for effect in self.problem.effects if effect.name in others])
            trials += trials_of(unbiased_like(self.problem, fit.plant), fit, found)
        return self._new(trials)

    def _siblings(self, names: Names, best: Names) -> list[Names]:
        """Try, beside `names`, effects that act like the others of `best`; return the sets with a new or better fit."""
        # This is done once for each fit of `best`, and only if it is the best of its size.
        found, fit = self.tried[best].calibration, self.tried[names].calibration
        done = self._replaced.get((best, names)) is found
        if done or not self.takes_most(best) or not self.is_best_of_its_size(best):
            return []
        self._replaced[best, names] = found
        added = tuple(name for name in best if name not in names)
        self._responses = self._responses or by_effect(self.known())
        alike = siblings(self.problem, found, added, self._open_beside(names, best), self._responses)
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
        """Return effects untried beside `names`, and timed ones that left clearly more there than `best`."""
        # The time of an event or a period is sought in a residual, so a trial that began from another one may have
        # missed it.
        least, floor = self.missing([best]), self.error_power(best)

        def is_open(effect: Effect) -> bool:
            tried = tuple(sorted((*names, effect.name)))
            if tried not in self.tried:
                return True
            timed = bool(effect.event) or effect.cycle(()) > 0.0
            return timed and least + floor < CLEARLY_LESS * (self.missing([tried]) + floor)

        rest, full = self.tried[names].calibration.plant, self.tried[best].calibration.plant
        # An effect of the set may act at another place, or another effect at a further place may do the same.
        others = [effect for effect in self.problem.everywhere if rest.lacks(effect)]
        return [effect for effect in others if effect.name not in full.effect_names and is_open(effect)]

    def _new(self, trials: Sequence[Trial], finished: Finished | None = None) -> list[Names]:
        """Try the trials of sets not tried before, compared with the best known set of the same size."""
        new = [t for t in trials if self.names_of(t) not in self.tried]
        size = len(self.names_of(new[0])) if new else 0
        return self.attempt(new, finished, self.least_rms([names for names in self.tried if len(names) == size]))

    def _good_alone(self, names: Names) -> list[Lead]:
        """Return the best single effects, because the score misses effects that a biased plant imitates."""
        alone = [single for single in self.tried if len(single) == 1 and single[0] not in names]
        return [self.leads[single[0]] for single in self.ranked(alone)[:FEW] if single[0] in self.leads]

    def replacing(self, before: Names, best: Names) -> list[Names]:
        """Try the `best` set of a stage with each of its earlier effects (`before`) replaced by others."""
        # If that gives a better set, its effects are replaced in turn.
        found = self._in_place_of(before, best)
        evidence = self.tried[best].evidence
        better = self.best_that_counts([names for names in found if self.tried[names].evidence > evidence])
        return found if better is None else found + self._in_place_of(better, better)

    def _in_place_of(self, several: Names, full: Names) -> list[Names]:
        """Try replacements of each of `several` effects of the set `full`, unless that was done."""
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
        """Try effects that act like one of the set `full` in its place, unless that was done."""
        rests = [rest for rest in each_without_one(full) if rest and rest in self.tried]
        return once([new for rest in rests for new in self._siblings(rest, full)])

    def _leads(self, names: Names, further: Sequence[Effect]) -> tuple[Lead, ...]:
        """Return what each of the `further` effects could explain of a candidate's residual."""
        asked = {effect.name for effect in further}
        events = self.event_leads(names) if any(effect.event for effect in further) else []
        found = most_promising(self._screened(names, further), *events)
        return tuple(lead for lead in found if lead.effect.name in asked)

    def _screened(self, names: Names, further: Sequence[Effect]) -> tuple[Lead, ...]:
        """Return what each effect could explain of a candidate's residual by its linearised response, without events."""
        fit, base = self.tried[names].calibration, self.tried[()].calibration
        if not names:
            return leads(self.known(), fit)
        free = [effect for effect in further if fit.plant.lacks(effect)]
        if (own := self.known(names)) is not self.known():
            return leads([f for f in own if f.effect.name in [e.name for e in free]], fit)
        looking = sought_in(fit, free, self.problem.fitted)
        again = linearised_responses(self.problem, base, looking, fit)
        others = {e.name for e in free} - {e.name for e in looking}
        return leads([*(f for f in self.known() if f.effect.name in others), *again], fit)

    def event_leads(self, *several: Names) -> list[tuple[Lead, ...]]:
        """Return what each event could explain beside each of `several` candidates, fitted to the data before the event."""
        fits = {names: self.tried[names].calibration for names in several}
        new = [names for names, fit in fits.items() if names not in self._events or self._events[names][0] is not fit]
        effects, parts = self.problem.effects, self.problem.fitted
        jobs = [(unbiased_like(self.problem, fits[names].plant), fits[names], effects, parts) for names in new]
        found = run_jobs(event_leads, jobs, workers=self.problem.jobs)
        self._events |= {names: (fits[names], events) for names, events in zip(new, found, strict=True)}
        return [self._events[names][1] for names in several]


def joint_trials(search: Search) -> list[Trial]:
    """Return trials of the most promising untried pairs, one effect of which has been tried alone."""
    # Adding a second effect to the best single one misses two effects that oppose each other: each alone explains
    # little, and a third may imitate both. To first order, the promise of a second effect costs no simulation, except
    # for events. A pair must promise nearly as much as the best possible pair tried so far removes.
    given = frozenset(search.problem.nominal.effect_names)
    tried = {frozenset(names) | given for names in search.tried}
    kept = [names for names, c in search.tried.items() if len(names) == 2 and search.is_possible(c)]
    least = (NEAR * search.least_rms(kept)) ** 2
    promising: dict[frozenset[str], Trial] = {}
    for left, trial in sorted(_of_all(search), key=lambda found: found[0]):
        names = frozenset(trial.start.effect_names)
        if left < least and names not in tried:
            promising.setdefault(names, trial)
    return list(promising.values())[:FEW]


def _of_all(search: Search) -> Iterator[tuple[float, Trial]]:
    """Yield each trial with the mean square that it leaves to first order, at any values of its parameters."""
    # Many single fits were given up before their minimum; what their own parameters would still remove is not
    # attributed to a second effect. For an event, which is estimated in another plant, the larger of two estimates is
    # used.
    singles = [names for names in search.tried if len(names) == 1]
    for names, events in zip(singles, search.event_leads(*singles), strict=True):
        fit = search.tried[names].calibration
        free = [f for f in search.known() if fit.plant.lacks(f.effect)]
        found = most_promising(leads(free, fit), events)
        alone = linearised_rms(fit.residuals, fit.movable) ** 2
        for lead, trial in zip(found, trials_of(unbiased_like(search.problem, fit.plant), fit, found), strict=True):
            yield max(lead.left, alone - lead.share * fit.rms**2), trial
