"""Everything a search for missing physics has tried: sets of effects, each fitted and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import reading_times
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.floor import floor_of
from deatwin.ident.mismatch.naming.candidate import Candidate, noise_seen
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.decide import Naming, decide, with_distances
from deatwin.ident.mismatch.naming.joint import joint_trials
from deatwin.ident.mismatch.naming.onsets import event_leads
from deatwin.ident.mismatch.naming.screen import Footprint, Lead, footprints, leads, most_promising
from deatwin.ident.mismatch.naming.shortlist import shortlist
from deatwin.ident.mismatch.naming.siblings import siblings
from deatwin.ident.mismatch.naming.trial import Fitted, Trial, refitted, run_trials, trials_of, unbent_like
from deatwin.ident.mismatch.naming.worth import TRIFLE, acts, explained, gained, held_back_by, takes_most
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant

__all__ = ["CLEARLY_BETTER", "Finished", "Names", "Search", "each_without_one", "once"]

BESIDE = 6
"""Effects that are tried beside others."""
ALONE = 3
"""Of the effects that were tried alone, those that are tried beside others whatever their score."""
CLEARLY_BETTER = 0.8
"""A rival form is gone on with where its best single effect leaves less than this share of the mean square."""
Finished = Callable[[float], None]
Names = tuple[str, ...]


def each_without_one(names: Names) -> list[Names]:
    """The sets that are left when each effect of `names` in turn is taken out."""
    return [tuple(name for name in names if name != old) for old in names]




def once(stage: Sequence[Names]) -> list[Names]:
    """The sets of a `stage` in their order, of which those that were tried again are in it twice."""
    return list(dict.fromkeys(stage))


def _is_better(fit: Calibration, known: Calibration) -> bool:
    """Whether a fit is to be kept for a known one: one that was given up says little of where it would have ended."""
    return known.given_up if known.given_up != fit.given_up else fit.rms < known.rms


class Search:
    """Everything tried so far; sets of effects are known by their names, a stage is a list of such sets of one size.

    Parameters
    ----------
    bench : Bench
        Effects and recordings.
    base : Candidate
        Without further effects.
    known : sequence of Footprint or None
        Of all effects in the base plant; None to simulate them once they are asked for.
    fitted : callable or None
        Called with each fit.
    """

    def __init__(
        self, bench: Bench, base: Candidate, known: Sequence[Footprint] | None, fitted: Fitted | None = None
    ) -> None:
        self.bench, self.fitted, self._known = bench, fitted, known
        self.tried: dict[Names, Candidate] = {(): base}
        self.leads: dict[str, Lead] = {}
        self.lost: list[str] = []
        self._gone_on: set[Names] = set()
        self._replaced: set[tuple[Names, Names]] = set()
        self._events: dict[Names, tuple[Calibration, tuple[Lead, ...]]] = {}
        self._unscreened: list[str] = [] if known is None else self._not_in(known)

    def in_form_of(self, base: Candidate) -> Search:
        """A search in another form of the plant, `base`, where nothing was tried yet."""
        other = Search(self.bench, base, None, self.fitted)
        other._unscreened = [name for name in self._unscreened if (name,) not in self.tried]
        return other

    @property
    def failed(self) -> list[str]:
        """Effects and sets of effects with which no plant could be simulated, in this form as far as that is known."""
        known = dict.fromkeys((*self._unscreened, *self.lost))
        return [names for names in known if tuple(names.split("+")) not in self.tried]

    def known(self) -> Sequence[Footprint]:
        """Footprints of all effects in the base plant of this form: those of another form say little of it."""
        if self._known is None:
            fit = self.tried[()].calibration
            self._known = footprints(self.bench, fit, self.bench.effects, fit)
            self._unscreened = self._not_in(self._known)
        return self._known

    def _not_in(self, known: Sequence[Footprint]) -> list[str]:
        seen = {footprint.effect.name for footprint in known}
        return [e.name for e in self.bench.effects if e.name not in seen]

    @property
    def noise(self) -> float:
        return self.tried[()].noise

    def _beyond_noise(self, mean_square: float) -> float:
        return max(mean_square - self.noise**2, 0.0)

    def best_of(self, stage: Sequence[Names]) -> Names | None:
        """The set of a `stage` with the most evidence; None of none."""
        return max(stage, key=lambda names: self.tried[names].evidence, default=None)

    def ranked(self, stage: Sequence[Names]) -> list[Names]:
        """The sets of a `stage`, those with the most evidence first."""
        return sorted(stage, key=lambda names: -self.tried[names].evidence)

    def with_one_more(self, stage: Sequence[Names], finished: Finished | None = None) -> list[Names]:
        """Sets of one more effect beside the best of a `stage`, and in its place; none where none helps.

        Of two also those that promise most together. `finished` is called with the share that is done.
        """
        beside = self._beside_one(stage, finished)
        together = [] if any(len(names) > 1 for names in stage) else self._together()
        return once([*beside, *together])

    def _beside_one(self, stage: Sequence[Names], finished: Finished | None) -> list[Names]:
        """The same from one set of a `stage` after another, until a further effect helps.

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
        return together + (self.replacing(best, best) if self._is_best_of_its_size(best) else [])

    def _is_best_of_its_size(self, names: Names) -> bool:
        """Whether none of as many effects that was tried has more evidence."""
        return names == self.best_of([other for other in self.tried if len(other) == len(names)])

    def best_that_counts(self, stage: Sequence[Names]) -> Names | None:
        """The set of a `stage` with the most evidence in which each effect counts; None of none."""
        # In their order, not all at once: to know whether a set counts may take a fit.
        return next((names for names in self.ranked(stage) if self.each_counts(names)), None)

    def _beginnings(self, stage: Sequence[Names]) -> list[Names]:
        """The sets of a `stage` beside which a further effect is looked for, in their order.

        A cycle of which the recordings show little imitates any drift: it comes after all others.
        """
        ranked = self.ranked([names for names in stage if not self.leaves_a_trifle(names)])
        ranked.sort(key=lambda names: not shows_its_cycles(self.tried[names], self.bench.everything))
        if any(len(names) > 1 for names in ranked):
            return [names for names in ranked[:1] if self._takes_most(self.tried[names])]
        return [*ranked[:1], *(names for names in ranked[1:2] if self._takes_most(self.tried[names]))]

    def beside(self, names: Names, finished: Finished | None = None) -> list[Names]:
        """Try each promising effect beside those of `names`; `finished` is called with the share that is done."""
        self._gone_on.add(names)
        fit = self.tried[names].calibration
        unbent = unbent_like(self.bench, fit.plant)
        found = self._leads(names)
        # What did well alone did it with another residual: of this one it promises nothing.
        alone = [replace(lead, share=0.0) for lead in self._good_alone(names)]
        promising = (*alone, *found[:BESIDE]) if names else shortlist(self.bench, unbent, found)
        chosen = {lead.effect.name: lead for lead in promising}
        self.leads = chosen | self.leads
        stage = self._new(trials_of(unbent, fit, chosen.values()), finished)
        best = self.best_of(stage)
        return stage if best is None else once([*stage, *self._siblings(names, best)])

    def _siblings(self, names: Names, best: Names) -> list[Names]:
        """Try beside `names` what acts as the rest of the set `best` does, unless that is not the best of its size.

        What is returned are the sets that were not known, or of which a better fit is known by now.
        """
        if not self._takes_most(self.tried[best]) or not self._is_best_of_its_size(best):
            return []
        found, fit = self.tried[best].calibration, self.tried[names].calibration
        added = tuple(name for name in best if name not in names)
        alike = siblings(self.bench, found, added, self._open_beside(names, best))
        bare, unbent = found.plant.without_effects(*added), fit.plant
        trials = [
            Trial(start=bare.with_effects(lead.estimate), bent=unbent.with_effects(lead.effect), without=fit)
            for lead in alike
        ]
        before = {known: candidate.calibration for known, candidate in self.tried.items()}
        tried = self.attempt(trials, rival=found.rms)
        better = [new for new in tried if self.tried[new].calibration is not before.get(new)]
        seen = {name for new in better for name in new}
        self.leads = self.leads | {lead.effect.name: lead for lead in alike if lead.effect.name in seen}
        return better

    def _open_beside(self, names: Names, best: Names) -> list[Effect]:
        """Effects that were not tried beside `names`, or have a time or a period and left clearly more than `best`.

        A time or a period is looked for in a residual, and what began in another one may not have found it.
        """
        least, floor = self.missing([best]), self.floor_power(best)

        def is_open(effect: Effect) -> bool:
            tried = tuple(sorted((*names, effect.name)))
            if tried not in self.tried:
                return True
            timed = bool(effect.event) or effect.cycle(()) > 0.0
            return timed and least + floor < CLEARLY_BETTER * (self.missing([tried]) + floor)

        given = self.tried[best].calibration.plant.effect_names
        return [effect for effect in self.bench.effects if effect.name not in given and is_open(effect)]

    def _new(self, trials: Sequence[Trial], finished: Finished | None = None) -> list[Names]:
        """Try what was not tried, against the best of the sets of as many effects."""
        new = [t for t in trials if self._names(t) not in self.tried]
        size = len(self._names(new[0])) if new else 0
        return self.attempt(new, finished, self.least_rms([names for names in self.tried if len(names) == size]))

    def least_rms(self, stage: Sequence[Names]) -> float:
        """The least that a fit of a stage leaves, SI."""
        return min((self.tried[names].calibration.rms for names in stage), default=float(np.inf))

    def _good_alone(self, names: Names) -> list[Lead]:
        """What explained most by itself: the score is blind to what the plant is still bent to imitate."""
        alone = [single for single in self.tried if len(single) == 1 and single[0] not in names]
        return [self.leads[single[0]] for single in self.ranked(alone)[:ALONE] if single[0] in self.leads]

    def leaves_a_trifle(self, names: Names) -> bool:
        """Whether no further effect beside `names` could count."""
        return explained(self.tried[names], self.tried[()]) > 1.0 - TRIFLE

    def may_be_misread(self, stage: Sequence[Names], naming: Naming, rival: Candidate) -> bool:
        """Whether the `rival` form of the plant could be what is missing, or what single effects of a `stage` lack.

        What is missing beside a wrong form takes most of the mismatch in this one, or the other form does by itself.
        `naming` is the decision over the stage.
        """
        if self.is_clearly_worse_than(rival):
            return True
        return naming.best is None and self.one_takes_most(stage)

    def one_takes_most(self, stage: Sequence[Names]) -> bool:
        """Whether the best of a `stage` takes away most of what is more than noise."""
        best = self.best_of(stage)
        return best is not None and self._takes_most(self.tried[best])

    def is_clearly_worse_than(self, rival: Candidate) -> bool:
        """Whether the `rival` form of the plant leaves clearly less without effects than this one."""
        return self._beyond_noise(float(rival.losses.mean())) < CLEARLY_BETTER * self.missing([()])

    def is_clearly_better_than(self, rival: Candidate) -> bool:
        """Whether the `rival` form of the plant leaves clearly more without effects than this one."""
        return self.missing([()]) <= CLEARLY_BETTER * self._beyond_noise(float(rival.losses.mean()))

    def least(self, stage: Sequence[Names]) -> float:
        """Mean square that the best of a `stage` leaves."""
        return min((float(self.tried[names].losses.mean()) for names in stage), default=float(np.inf))

    def missing(self, stage: Sequence[Names]) -> float:
        """Mean square beyond the noise that the best of a `stage` leaves."""
        return self._beyond_noise(self.least(stage))

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
        for old in several:
            rest = tuple(name for name in full if name != old)
            done = rest in self._gone_on
            if rest not in self.tried or self.tried[rest].calibration.given_up:
                self._fit_some(full, rest)
                done = False
            if rest in self.tried:
                found += [] if done else self.beside(rest)
                found += self._once_in_place_of(full, rest)
        return found

    def alike(self, full: Names) -> list[Names]:
        """Try what acts as each of several effects of the set `full` in the place of it, unless that was done."""
        rests = [rest for rest in each_without_one(full) if rest and rest in self.tried]
        return once([new for rest in rests for new in self._once_in_place_of(full, rest)])

    def _once_in_place_of(self, full: Names, rest: Names) -> list[Names]:
        """Try what acts as the effects of `full` besides `rest` do, unless that was done."""
        if (full, rest) in self._replaced:
            return []
        self._replaced.add((full, rest))
        return self._siblings(rest, full)

    def each_counts(self, names: Names) -> bool:
        """Whether what returns when any effect of `names` is taken out is more than the model error, and no trifle."""
        least = max(self.floor_power(names), TRIFLE * self.missing([()]))
        return all(gained(self.tried[names], less) >= least for less in self.without_one(names))

    def without_one(self, names: Names) -> Iterator[Candidate]:
        """The sets without one effect of `names`, those first that are known: each other one takes a fit."""
        for rest in sorted(each_without_one(names), key=lambda rest: rest not in self.tried):
            if rest not in self.tried and "+".join(rest) not in self.failed:
                self._fit_some(names, rest)
            if rest in self.tried:
                yield self.tried[rest]

    def floor_power(self, names: Names) -> float:
        """Power of the plant's own error, as the set `names` is judged by it."""
        return float(self.tried[names].calibration.plant.rig.model_error ** 2)

    def judge_by_the_best(self, stage: Sequence[Names]) -> None:
        """The base plant was bent to imitate what is missing; the best of a `stage` knows the plant's error better."""
        best = self.best_of(stage)
        if best is None:
            return
        error = max(self.bench.nominal.rig.model_error, floor_of(self.tried[best].calibration.plant, self.bench))
        for names in stage:
            self.tried[names] = self.tried[names].with_floor(error)

    def is_own(self, candidate: Candidate) -> bool:
        """Whether a candidate was fitted in this search, in this form of the plant."""
        known = self.tried.get(candidate.effects)
        return known is not None and known.calibration is candidate.calibration

    def counts(self, candidate: Candidate) -> bool:
        """Whether a candidate takes away most of the mismatch, and its effects do, in a plant within its ranges."""
        return self.is_possible(candidate) and acts(candidate, self.tried[()])

    def is_possible(self, candidate: Candidate) -> bool:
        """Whether a candidate takes away most of the mismatch, in a plant within its ranges."""
        return self._takes_most(candidate) and not held_back_by(candidate)

    def _takes_most(self, candidate: Candidate) -> bool:
        return takes_most(candidate, self.tried[()])

    def is_padded(self, names: Names) -> bool:
        """Whether what would be an explanation, the effects `names`, has one that adds nothing to it."""
        return len(names) > 1 and self._takes_most(self.tried[names]) and not self.each_counts(names)

    def decision(self, competing: Sequence[Candidate], good: Callable[[Candidate], bool]) -> Naming:
        """The decision among the `competing` candidates, of which those that are `good` may lead."""
        naming = decide(tuple(self.tried.values()), competing, self.noise, good, self.is_possible)
        return with_distances(naming, competing, self.bench, self.is_possible)

    def attempt(
        self, trials: Sequence[Trial], finished: Finished | None = None, rival: float = np.inf
    ) -> list[Names]:
        """Fit and judge `trials`, which compete with a `rival` rms; `finished` is called with the share that is done.

        What is returned are the sets that could be fitted.
        """
        found = run_trials(self.bench, trials, self.noise, finished, self.fitted, rival)
        self._know(found, [self._names(t) for t in trials])
        return [candidate.effects for candidate in found]

    def _know(self, found: Sequence[Candidate], asked: Sequence[Names]) -> None:
        """Keep what was `found` of the sets that were `asked` for, unless a better fit is known."""
        for candidate in found:
            known = self.tried.get(candidate.effects)
            if known is None or _is_better(candidate.calibration, known.calibration):
                self.tried[candidate.effects] = candidate
        self.lost += ["+".join(names) for names in asked if names not in self.tried]
        # What a wrong plant leaves at the top of the spectrum is no noise: the best explanation shows the least.
        noise = min([self.noise, *(noise_seen(c.calibration, self.bench.fitted) for c in found)])
        self.tried = {names: replace(candidate, noise=noise) for names, candidate in self.tried.items()}

    def _fit_some(self, full: Names, rest: Names) -> None:
        """Fit some of the effects of a candidate."""
        plant = self.plant_of(full, rest)
        self.attempt([Trial(start=unbent_like(self.bench, plant), bent=plant, without=self.tried[()].calibration)])

    def fit_fewer(self, full: Names) -> list[Names]:
        """Fit `full` without each of its effects in turn, from its values; the sets that could be fitted.

        A fit of fewer effects that was given up or left rough may have been far from its minimum.
        """
        fewer = each_without_one(full)
        self.fit_from(full, fewer)
        return [rest for rest in fewer if rest in self.tried]

    def fit_from(self, full: Names, several: Sequence[Names]) -> None:
        """Fit `several` sets of effects of the set `full` from the values of that."""
        plants = [self.plant_of(full, rest) for rest in several]
        # What cannot begin from there may from elsewhere: it is not lost yet.
        self._know(refitted(self.bench, plants, self.noise, self.fitted), ())

    def plant_of(self, full: Names, rest: Names) -> Plant:
        """The plant of the set `full` with the effects of `rest` only, not fitted anew."""
        plant, gone = self.tried[full].calibration.plant, [name for name in full if name not in rest]
        return plant.without_effects(*gone) if gone else plant

    def _names(self, trial: Trial) -> Names:
        return tuple(name for name in trial.start.effect_names if name not in self.bench.nominal.effect_names)

    def _leads(self, names: Names) -> tuple[Lead, ...]:
        """What each further effect could explain of what a candidate leaves."""
        return most_promising(self._screened(names), *self.event_leads(names))

    def _screened(self, names: Names) -> tuple[Lead, ...]:
        """The same as far as the fit itself tells."""
        fit, base = self.tried[names].calibration, self.tried[()].calibration
        if not names:
            return leads(self.known(), fit)
        free = [effect for effect in self.bench.effects if effect.name not in fit.plant.effect_names]
        times = reading_times(base.plant, self.bench.fitted)
        looking = [effect for effect in free if effect.starts(times, fit.residuals)]
        again = footprints(self.bench, base, looking, fit)
        others = {e.name for e in free} - {e.name for e in looking}
        return leads([*(f for f in self.known() if f.effect.name in others), *again], fit)

    def event_leads(self, *several: Names) -> list[tuple[Lead, ...]]:
        """What each event could explain beside the effects of each of `several` candidates, seen from before it."""
        fits = {names: self.tried[names].calibration for names in several}
        new = [names for names, fit in fits.items() if names not in self._events or self._events[names][0] is not fit]
        effects, parts = self.bench.effects, self.bench.fitted
        jobs = [(unbent_like(self.bench, fits[names].plant), fits[names], effects, parts) for names in new]
        found = run_jobs(event_leads, jobs, workers=self.bench.jobs)
        self._events |= {names: (fits[names], events) for names, events in zip(new, found, strict=True)}
        return [self._events[names][1] for names in several]
