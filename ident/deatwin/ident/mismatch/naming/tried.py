"""Record of a search for missing physics: all sets of effects tried, each fitted and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.model_error import model_error_of
from deatwin.ident.mismatch.naming.candidate import Candidate, noise_seen
from deatwin.ident.mismatch.naming.criteria import TRIFLE, acts, explained, gained, held_back_by, takes_most
from deatwin.ident.mismatch.naming.decide import Distances, Naming, decide, with_distances
from deatwin.ident.mismatch.naming.evidence_ratio import advantage
from deatwin.ident.mismatch.naming.refit_all_data import settled_on_everything
from deatwin.ident.mismatch.naming.trial import Fitted, Trial, completed, refitted, run_trials, with_fitted, with_little
from deatwin.ident.mismatch.naming.weigh import Scale
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import CLEARLY_LESS, DISTINGUISHED, STRONG
from deatwin.plant.model import Plant
from deatwin.plant.resolution import followed_plant

Finished = Callable[[float], None]
Names = tuple[str, ...]


def each_without_one(names: Names) -> list[Names]:
    """Return the subsets of `names` without one of its effects."""
    return [tuple(name for name in names if name != old) for old in names]


def once(stage: Sequence[Names]) -> list[Names]:
    """Return the sets of a `stage` in order, without duplicates."""
    return list(dict.fromkeys(stage))


def _is_better(fit: Calibration, known: Calibration) -> bool:
    """Return whether a fit replaces the known one: only it was completed, or it leaves less."""
    return known.given_up if known.given_up != fit.given_up else fit.rms < known.rms


class Tried:
    """All candidates tried so far. A set of effects is a tuple of names; a stage is a list of sets of one size."""

    def __init__(self, problem: DiagnosisProblem, base: Candidate, fitted: Fitted | None = None) -> None:
        self.problem, self.fitted = problem, fitted
        self.tried: dict[Names, Candidate] = {(): base}
        self.lost: list[str] = []
        self._distances: Distances = {}
        self._broadened: dict[Names, Calibration] = {}
        self._scale: tuple[tuple[float, int], Scale] | None = None
        self.unscreened: list[str] = []

    @property
    def failed(self) -> list[str]:
        """Return the sets of effects with which this variant of the plant could not be simulated."""
        known = dict.fromkeys((*self.unscreened, *self.lost))
        return [names for names in known if tuple(names.split("+")) not in self.tried]

    @property
    def noise(self) -> float:
        return self.tried[()].noise

    @property
    def scale(self) -> Scale:
        """The likelihood of candidates with the present base fit and noise; it keeps what it has computed."""
        base = self.tried[()]
        key = self.noise, id(base.calibration)  # the scale holds the base, so the id stays valid
        if self._scale is None or self._scale[0] != key:
            self._scale = key, Scale(problem=self.problem, base=base, noise=self.noise)
        return self._scale[1]

    def best_of(self, stage: Sequence[Names]) -> Names | None:
        """Return the set of a `stage` with the most evidence; None if the stage is empty."""
        return max(stage, key=lambda names: self.tried[names].evidence, default=None)

    def ranked(self, stage: Sequence[Names]) -> list[Names]:
        """Return the sets of a `stage`, the most evidence first."""
        return sorted(stage, key=lambda names: -self.tried[names].evidence)

    def is_best_of_its_size(self, names: Names) -> bool:
        """Return whether no tried set of as many effects has more evidence than `names`."""
        return names == self.best_of([other for other in self.tried if len(other) == len(names)])

    def best_that_counts(self, stage: Sequence[Names]) -> Names | None:
        """Return the set with the most evidence among those of a `stage` in which each effect counts, or None."""
        # Sets are tested one after another, because a test may take a fit.
        return next((names for names in self.ranked(stage) if self.each_counts(names)), None)

    def least_rms(self, stage: Sequence[Names]) -> float:
        """Return the smallest rms residual of a `stage`, SI."""
        return min((self.tried[names].calibration.rms for names in stage), default=float(np.inf))

    def least(self, stage: Sequence[Names]) -> float:
        """Return the smallest mean square residual of a `stage`."""
        return min((float(self.tried[names].losses.mean()) for names in stage), default=float(np.inf))

    def missing(self, stage: Sequence[Names]) -> float:
        """Return the smallest mean square residual of a `stage` beyond noise."""
        return self._beyond_noise(self.least(stage))

    def _beyond_noise(self, mean_square: float) -> float:
        return max(mean_square - self.noise**2, 0.0)

    def error_power(self, names: Names) -> float:
        """Return the power of the model error by which the set `names` is judged."""
        return float(self.tried[names].calibration.plant.rig.model_error ** 2)

    def judge_by_the_best(self, stage: Sequence[Names]) -> None:
        """Estimate the model error anew from the best set of a `stage`, because the base fit is biased."""
        best = self.best_of(stage)
        if best is None:
            return
        error = max(
            self.problem.nominal.rig.model_error, model_error_of(self.tried[best].calibration.plant, self.problem)
        )
        for names in stage:
            self.tried[names] = self.tried[names].with_floor(error)

    def more_finely(self, stage: Sequence[Names]) -> Plant | None:
        """Return the rig with the fitted values of the best set of a `stage`, and with as many steps as it then needs;
        None if it needs no more than in the search.
        """
        # Friction that is missing is imitated by damping, and a plant that is damped too much seems to need few steps.
        best = self.best_of(stage)
        if best is None:
            return None
        plant, parts = self.plant_of(best, ()), self.problem.of_first.fitted
        followed, _ = followed_plant(plant, [part.experiment for part in parts])
        return None if followed is plant else followed

    def takes_most(self, names: Names) -> bool:
        """Return whether the set `names` removes most of the residual's power beyond noise."""
        return takes_most(self.tried[names], self.tried[()])

    def one_takes_most(self, stage: Sequence[Names]) -> bool:
        """Return whether the best set of a `stage` removes most of the residual's power beyond noise."""
        best = self.best_of(stage)
        return best is not None and self.takes_most(best)

    def leaves_a_trifle(self, names: Names) -> bool:
        """Return whether no further effect beside `names` could count."""
        return explained(self.tried[names], self.tried[()]) > 1.0 - TRIFLE

    def each_counts(self, names: Names) -> bool:
        """Return whether each effect of `names` removes more than the model error and 5 % of the mismatch's power."""
        if subsets := self._worth_fitting(names):
            self.fit_subsets(subsets)
        return self._each_known_counts(names)

    def _worth_fitting(self, names: Names) -> dict[Names, Names]:
        """Return the unknown subsets of `names`, each mapped to it, unless a known one shows that an effect does not
        count.
        """
        # All of them are fitted side by side: one that shows that an effect does not count need not be the best one,
        # since the effect that was added first may only have led to the others.
        fewer = each_without_one(names) if self._each_known_counts(names) else []
        return {rest: names for rest in fewer if self._is_open(rest)}

    def _each_known_counts(self, names: Names) -> bool:
        """Return whether the effects of `names` count beside each known subset."""
        return all(
            self._counts_beside(names, self.tried[rest]) for rest in each_without_one(names) if rest in self.tried
        )

    def _counts_beside(self, names: Names, less: Candidate) -> bool:
        """Return whether the effect of `names` that a candidate lacks removes enough."""
        least = max(self.error_power(names), TRIFLE * self.missing([()]))
        return gained(self.tried[names], less) >= least

    def without_one(self, names: Names) -> Iterator[Candidate]:
        """Yield the candidates without one effect of `names`, the known ones first, because each other one takes a fit."""
        for rest in sorted(each_without_one(names), key=lambda rest: rest not in self.tried):
            if self._is_open(rest):
                self.fit_some(names, rest)
            if rest in self.tried:
                yield self.tried[rest]

    def _is_open(self, names: Names) -> bool:
        """Return whether a set has neither been fitted nor failed."""
        return names not in self.tried and "+".join(names) not in self.failed

    def unpadded(self, stage: Sequence[Names]) -> list[Names]:
        """Return the sets of a `stage` without those that remove most of the mismatch, but with an effect that does not
        count.
        """
        # The fits that this takes are made side by side.
        asked = [names for names in stage if len(names) > 1 and self.takes_most(names)]
        subsets: dict[Names, Names] = {}
        for names in asked:
            subsets = self._worth_fitting(names) | subsets
        self.fit_subsets(subsets)
        padded = {names for names in asked if not self.each_counts(names)}
        return [names for names in stage if names not in padded]

    def is_own(self, candidate: Candidate) -> bool:
        """Return whether a candidate was fitted in this search, in this variant of the plant."""
        known = self.tried.get(candidate.effects)
        return known is not None and known.calibration is candidate.calibration

    def is_possible(self, candidate: Candidate) -> bool:
        """Return whether a candidate removes most of the mismatch, in a plant within its ranges."""
        return takes_most(candidate, self.tried[()]) and not held_back_by(candidate)

    def may_return(self, naming: Naming, candidate: Candidate) -> bool:
        """Return whether fits to all recordings may restore a candidate as an alternative to the best one."""
        # It may have failed where it was extrapolated, and then need not remove most of the mismatch there.
        fitted = takes_most(candidate.fitted_part, self.tried[()].fitted_part) and not held_back_by(candidate)
        far = {d.effects[1] for d in naming.distances if d.d2 >= DISTINGUISHED}
        if naming.best is not None and "+".join(candidate.effects) in far and self.is_refuted(candidate, naming.best):
            return False
        return fitted or self.is_possible(candidate)

    def counts(self, candidate: Candidate) -> bool:
        """Return whether a candidate's effects explain most of the mismatch in a plant within its ranges."""
        return self.is_possible(candidate) and acts(candidate, self.tried[()])

    def decision(self, competing: Sequence[Candidate], good: Callable[[Candidate], bool]) -> Naming:
        """Decide among the `competing` candidates; only `good` ones can be the best."""
        naming = decide(tuple(self.tried.values()), competing, self.noise, good, self.is_possible)
        return self.with_distances(naming, competing)

    def settled(self, competing: Sequence[Candidate], hopeful: Callable[[Candidate], bool]) -> Naming:
        """Decide among the `competing` candidates by fits to all recordings; one of them must be `hopeful`."""
        tried = tuple(self.tried.values())
        naming = settled_on_everything(competing, tried, self.problem, hopeful, self.is_possible)
        return self.with_distances(naming, competing)

    def with_distances(self, naming: Naming, competing: Sequence[Candidate]) -> Naming:
        """Add to a decision the `competing` candidates that these inputs cannot distinguish from its best."""
        return with_distances(
            naming, competing, self.problem, self.is_possible, known=self._distances, refuted=self.is_refuted
        )

    def is_refuted(self, candidate: Candidate, best: Candidate) -> bool:
        """Return whether the likelihood is strong evidence for `best` over a candidate whose law may err, and the
        held-out data do not contradict it.
        """
        return self.scale.over(best, candidate) > STRONG and advantage(best, candidate) > 0.0

    def is_clearly_worse_than(self, alternative: Candidate) -> bool:
        """Return whether the `alternative` variant of the plant leaves clearly less without effects than this one."""
        return self._beyond_noise(float(alternative.losses.mean())) < CLEARLY_LESS * self.missing([()])

    def is_clearly_better_than(self, alternative: Candidate) -> bool:
        """Return whether the `alternative` variant of the plant leaves clearly more without effects than this one."""
        return self.missing([()]) <= CLEARLY_LESS * self._beyond_noise(float(alternative.losses.mean()))

    def may_be_misread(self, stage: Sequence[Names], naming: Naming, alternative: Candidate) -> bool:
        """Return whether the `alternative` variant could explain the mismatch, or what single effects leave of it."""
        if self.is_clearly_worse_than(alternative):
            return True
        return naming.best is None and self.one_takes_most(stage)

    def attempt(
        self, trials: Sequence[Trial], finished: Finished | None = None, alternative: float = np.inf
    ) -> list[Names]:
        """Fit and judge `trials` against the rms residual of an `alternative`; return sets with a new or better fit."""
        found = run_trials(self.problem, trials, self.noise, finished, self.fitted, alternative)
        better = self._know(found)
        self.lost += ["+".join(names) for names in map(self.names_of, trials) if names not in self.tried]
        # a single effect has been fitted from the values of the base plant, its only subset
        self.no_worse([c for c in better if len(c) > 1 and not self.tried[c].calibration.given_up])
        return better

    def _know(self, found: Sequence[Candidate]) -> list[Names]:
        """Keep the candidates `found` unless a better fit is known; return their sets."""
        if not found:
            return []
        better = []
        for candidate in found:
            known = self.tried.get(candidate.effects)
            if known is None or _is_better(candidate.calibration, known.calibration):
                self.tried[candidate.effects] = candidate
                better.append(candidate.effects)
        # A wrong plant also leaves power at the highest frequencies, so the smallest noise estimate is used.
        noise = min([self.noise, *(noise_seen(c.calibration, self.problem.fitted) for c in found)])
        self.tried = {names: replace(candidate, noise=noise) for names, candidate in self.tried.items()}
        return better

    def fit_some(self, full: Names, rest: Names) -> None:
        """Fit the subset `rest` of the set `full`, from the values of `full`, with nominal and with fitted values of the
        rig.
        """
        self.fit_subsets({rest: full})

    def fit_subsets(self, subsets: Mapping[Names, Names]) -> None:
        """Fit subsets, each of the set to which it is mapped, as `fit_some` does, side by side."""
        # The values of the larger set are the least biased that are known; only the rig's own begin anew.
        plants = [self.plant_of(full, rest) for rest, full in subsets.items()]
        starts = [with_fitted(self.problem.nominal.with_rig(plant.rig), plant) for plant in plants]
        without = self.tried[()].calibration
        pairs = zip(starts, plants, strict=True)
        trials = [Trial(start=start, biased=plant, without=without) for start, plant in pairs]
        self._know(completed(self.problem, trials, self.noise, self.fitted))
        self.lost += ["+".join(rest) for rest in subsets if rest not in self.tried]

    def fit_fewer(self, full: Names) -> list[Names]:
        """Fit `full` without each of its effects in turn, from its values; return the sets that could be fitted."""
        # An earlier fit of such a set may have been given up or left rough, far from its minimum. And the effect that
        # is left out may merely have corrected the law of another one.
        fewer = each_without_one(full)
        self.fit_from(full, fewer)
        fewer = [rest for rest in fewer if rest in self.tried]
        self.broaden(fewer)
        return fewer

    def fit_from(self, full: Names, several: Sequence[Names]) -> None:
        """Fit `several` subsets of the set `full` from its values."""
        plants = [self.plant_of(full, rest) for rest in several]
        # A fit that fails from these values may succeed from others, so it is not recorded as lost.
        self.refit(plants)

    def refit(self, plants: Sequence[Plant]) -> None:
        """Fit plants from their present values; keep each fit that leaves less than the known one."""
        self._know(refitted(self.problem, plants, self.noise, self.fitted))

    def broaden(self, stage: Sequence[Names]) -> None:
        """Refit the sets of a `stage` that remove most of the mismatch, with more general laws of their effects.

        The more general law is kept where it has more evidence.
        """
        fits = {names: self.tried[names].calibration for names in stage if self.takes_most(names)}
        plants = [fit.plant for names, fit in fits.items() if self._broadened.get(names) is not fit]
        self._broadened |= fits
        wider = [(plant, tuple(effect.broadened() or effect for effect in plant.effects)) for plant in plants]
        new = [replace(plant, effects=effects) for plant, effects in wider if effects != tuple(plant.effects)]
        found = refitted(self.problem, new, self.noise, self.fitted) if new else []
        self._know([c for c in found if c.evidence > self.tried[c.effects].evidence])

    def no_worse(self, several: Sequence[Names]) -> None:
        """Refit sets that leave more than one of their subsets, from the values of the best subset."""
        # A subset is a special case, so the fit of the set, which began elsewhere, has missed its minimum.
        begun = []
        for names in several:
            subsets = [self.tried[rest].calibration for rest in each_without_one(names) if rest in self.tried]
            best, found = min(subsets, key=lambda fit: fit.rms, default=None), self.tried[names].calibration
            if best is not None and best.rms < found.rms:
                begun.append(with_little(found.plant, best))
        if begun:
            self.refit(begun)

    def plant_of(self, full: Names, rest: Names) -> Plant:
        """Return the plant of the set `full` with the effects of `rest` only, not refitted."""
        plant, gone = self.tried[full].calibration.plant, [name for name in full if name not in rest]
        return plant.without_effects(*gone) if gone else plant

    def names_of(self, trial: Trial) -> Names:
        """Return the set of effects of a `trial`."""
        return tuple(name for name in trial.start.effect_names if name not in self.problem.nominal.effect_names)
