"""One trial: build effects into the plant, refit all parameters, and judge the fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.status import FitStatus
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import (
    ROUGH,
    ROUGHLY,
    at_its_time,
    finish,
    further,
    in_a_wider_range,
    in_its_gap,
    roughly,
    search,
    where_it_acts,
)
from deatwin.ident.mismatch.thresholds import MOST, NEGLIGIBLE, PRACTICAL_SHARE
from deatwin.ident.parallel import run_jobs, stream_jobs
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter
from deatwin.plant.resolution import followed_plant, solved_like

FAILED_SEARCH = 1.02
"""Ratio of the rms residual to its prediction above which a fit has failed to find the minimum."""
FEW = 4
"""Number of simulations that show whether a start from the biased plant is promising."""
NEAR = 1.0 + PRACTICAL_SHARE
"""Ratio to the best rms residual within which a fit, or its linearised minimum, must be to be completed."""
HOPELESS = 1.5
"""Ratio of a fit's linearised minimum to the rms residual of another fit above which the fit is given up. In fits to
all samples the linearised minimum at the first point is mostly within 15 % of the final value."""
FIRST = 2
"""Number of trials that are made first; the others must come near to the best of them."""
OTHERWISE = (-1.0, 0.1, 1e-3)
"""Shares of the new effect's strength with which a fit begins if it cannot begin with the full strength."""
Fitted = Callable[[Calibration, np.ndarray | None], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Start of the fit of a set of effects."""

    start: Plant  # the effects, at values that were not biased by a fit without them
    biased: Plant  # second start, at the values of the best fit without the last effect
    without: Calibration  # fit without the last effect, a special case of this one
    # share of that fit's squared residual that the last effect explains to first order; 0 if unknown
    share: float = 0.0

    @property
    def promised(self) -> float:
        """Largest rms residual that the fit should leave, SI: the first-order prediction, or that without the effect."""
        return self.without.rms * float(np.sqrt(max(1.0 - self.share, 0.0)))


def trials_of(unbiased: Plant, fit: Calibration, chosen: Iterable[Lead]) -> list[Trial]:
    """Return trials of single effects in the unbiased plant and, at their estimated strengths, in the fitted plant."""
    return [
        Trial(
            start=unbiased.with_effects(lead.effect),
            biased=fit.plant.with_effects(lead.estimate),
            without=fit,
            share=lead.share,
        )
        for lead in chosen
    ]


def run_trials(
    problem: DiagnosisProblem,
    trials: Sequence[Trial],
    noise: float,
    finished: Callable[[float], None] | None = None,
    fitted: Fitted | None = None,
    alternative: float = np.inf,
) -> list[Candidate]:
    """Fit and judge each trial, the most promising first; give up fits that cannot come near the best.

    Trials whose plant cannot be simulated are left out. `finished` is called with the share that is done; `fitted` with
    each new fit and None, and again with the fit and its held-out residuals, SI. `alternative` is the rms residual of
    the best competing fit so far, SI.
    """
    fits: list[Calibration] = []
    done = 0
    first = FIRST if np.isinf(alternative) else len(trials)
    for group in (trials[:first], trials[first:]):
        tasks = [(problem, trial, HOPELESS * alternative) for trial in group]
        for found in stream_jobs(_tried, tasks, workers=problem.jobs):
            done += 1
            if found.status.ok:
                fits.append(found)
                if fitted is not None:
                    fitted(found, None)
            if finished is not None:
                finished(done / len(trials))
        alternative = min([alternative, *(fit.foreseen for fit in fits)])
    near = [k for k, fit in enumerate(fits) if _is_near(fit, alternative)]
    longest_first = sorted(range(len(fits)), key=lambda k: k not in near)
    jobs = [(problem, fits[k], noise, k in near) for k in longest_first]
    ended = dict(zip(longest_first, run_jobs(_ended, jobs, workers=problem.jobs), strict=True))
    return _told([ended[k] for k in range(len(fits))], fitted)


def _is_near(fit: Calibration, alternative: float) -> bool:
    """Return whether a fit may leave hardly more than an `alternative`, rms, SI, or at most the model error more."""
    return fit.within_reach < max(NEAR * alternative, float(np.hypot(alternative, fit.plant.rig.model_error)))


def completed(
    problem: DiagnosisProblem, trials: Sequence[Trial], noise: float, fitted: Fitted | None = None
) -> list[Candidate]:
    """Fit each trial to its end, independently of the others, and judge it; `fitted` as for `run_trials`."""
    return _told(run_jobs(_completed, [(problem, trial, noise) for trial in trials], workers=problem.jobs), fitted)


def refitted(
    problem: DiagnosisProblem, plants: Sequence[Plant], noise: float, fitted: Fitted | None = None
) -> list[Candidate]:
    """Fit plants from their present values, and judge them; those that cannot be simulated are left out."""
    return _told(run_jobs(_from_there, [(problem, plant, noise) for plant in plants], workers=problem.jobs), fitted)


def _told(judged: Sequence[Candidate | None], fitted: Fitted | None) -> list[Candidate]:
    candidates = [candidate for candidate in judged if candidate is not None]
    if fitted is not None:
        for candidate in candidates:
            fitted(candidate.calibration, candidate.unseen)
    return candidates


def with_fitted(nominal: Plant, fitted: Plant) -> Plant:
    """Return the nominal plant with another plant's effects, their values, and the stages and steps that these need."""
    added = [effect for effect in fitted.effects if effect.name not in nominal.effect_names]
    own = {p.name: fitted.parameters[p.name].value for effect in added for p in effect.parameters}
    return solved_like(nominal.with_effects(*added).with_values(own), fitted)


def unbiased_like(problem: DiagnosisProblem, fitted: Plant) -> Plant:
    """Return the nominal plant in the rig variant of a fitted one, with its effects at unbiased values."""
    # A fit without the next effect biases the values of the others too: next to a drift that is missing, a relaxation
    # becomes far slower, and from there a fit may end in another valley. So effects begin at typical values. What a fit
    # cannot find is kept: directions, and all values of effects with events, thresholds or periods.
    nominal = problem.nominal.with_rig(fitted.rig)
    typical = {effect.name: effect for effect in problem.everywhere}
    begun = with_fitted(nominal, fitted)
    values: dict[str, float] = {}
    for effect in fitted.effects:
        if nominal.lacks(effect) and effect.name in typical and not _is_sought(effect):
            values |= {p.name: p.value for p in typical[effect.name].parameters}
            strength = f"{effect.name}.{effect.strength}"
            values[strength] = _signed(values[strength], begun.parameters[strength])
    return begun.with_values(values) if values else begun


def _is_sought(effect: Effect) -> bool:
    """Return whether an effect's values are found by search in the data, because a fit cannot move them far."""
    return bool(effect.event or effect.threshold or effect.cycle(()))


def _signed(typical: float, fitted: Parameter) -> float:
    """Return a typical strength with the sign of the fitted one, within its range."""
    return float(np.clip(np.copysign(typical, fitted.value), fitted.lower, fitted.upper))


def _tried(problem: DiagnosisProblem, trial: Trial, hopeless: float) -> Calibration:
    """Fit from the unbiased plant and, if the result is worse than predicted, also from the biased one."""
    # A fit without an effect is biased: it imitates the effect with parameters that are far from the right ones. But
    # the minimum that the score predicts is near this fit, and a search from far away may end elsewhere. If a fit
    # leaves more than the fit without the new effects, it is repeated from that fit with a little of them. If no start
    # can be simulated, the effect is reversed or reduced: a softening spring may release the ball, a hardening or
    # weaker one does not.
    found = search(trial.start, problem.fitted, hopeless)
    if found.given_up and found.rms**2 < MOST * trial.without.rms**2:
        # the linearised minimum is least accurate far from the minimum
        found = _continued(found, problem, np.inf)
    # The plant without the effect is a special case, so a worse fit means that the search failed.
    if not found.status.ok or found.foreseen > FAILED_SEARCH * trial.promised:
        again = descend(trial.biased, problem.fitted, evaluations=FEW, tolerance=ROUGH, hopeless=hopeless)
        if again.status is FitStatus.STOPPED and _better(found, again) is again:
            again = _continued(again, problem, hopeless)
        found = _better(found, again)
    if found.status.ok and not found.given_up:  # where a guess has no influence, no fit finds its way from it
        guessed = {p.name for p in trial.start.parameters.values() if p.guessed}
        moved = where_it_acts(found, problem.fitted, guessed)
        found = found if moved is found.plant else _better(found, roughly(moved, problem.fitted, hopeless))
    if found.status.ok and not found.given_up and found.foreseen > FAILED_SEARCH * trial.without.rms:
        found = _better(found, roughly(with_little(trial.start, trial.without), problem.fitted, hopeless))
    for start in _otherwise(trial):
        if found.status.ok:
            break
        found = search(start, problem.fitted, hopeless)
    if not found.status.ok:
        return found
    placed = at_its_time(found, problem.fitted, hopeless, ROUGH)
    return in_a_wider_range(placed, trial.start, problem.fitted, hopeless)


def _completed(problem: DiagnosisProblem, trial: Trial, noise: float) -> Candidate | None:
    """Fit a trial to its end and judge it."""
    found = _tried(problem, trial, np.inf)
    return _ended(problem, found, noise, True) if found.status.ok else None


def _from_there(problem: DiagnosisProblem, plant: Plant, noise: float) -> Candidate | None:
    """Fit a plant from its values, or from other ones if these cannot be simulated without the removed effects."""
    found = roughly(plant, problem.fitted)
    found = found if found.status.ok else search(plant, problem.fitted)
    return _ended(problem, found, noise, True) if found.status.ok else None


def _ended(problem: DiagnosisProblem, fit: Calibration, noise: float, to_the_end: bool) -> Candidate | None:
    """Complete a fit, or leave it as it is, and judge it."""
    return judge(problem, _finished(problem, fit, noise) if to_the_end else fit, noise)


def _finished(problem: DiagnosisProblem, fit: Calibration, noise: float) -> Calibration:
    """Complete a fit; held-out data place an event that it cannot."""
    completed = finish(at_its_time(fit, problem.fitted, enough=NEGLIGIBLE), problem.fitted)
    completed = _followed(completed, problem, noise)
    return in_its_gap(completed, problem.fitted, problem.everything)


def _followed(fit: Calibration, problem: DiagnosisProblem, noise: float) -> Calibration:
    """Fit again with more steps per sample if noise does not hide the error of integration."""
    # At its largest it takes a quarter of the power that the fit may leave beyond the noise.
    hidden = practical_size(noise, fit.plant.rig.model_error) / 2
    plant, _ = followed_plant(fit.plant, [part.experiment for part in problem.of_first.fitted], hidden)
    if plant is fit.plant:
        return fit
    again = descend(plant, problem.fitted, tolerance=NEGLIGIBLE)
    return finish(again, problem.fitted) if again.status.ok else fit


def _continued(fit: Calibration, problem: DiagnosisProblem, hopeless: float) -> Calibration:
    """Continue a fit roughly; return it as it is if that fails."""
    again = further(fit, problem.fitted, **ROUGHLY, hopeless=hopeless)
    return again if again.status.ok else fit


def _better(one: Calibration, other: Calibration) -> Calibration:
    """Return the fit that leaves less; if one failed, the other."""
    return other if other.status.ok and (not one.status.ok or other.foreseen < one.foreseen) else one


def with_little(start: Plant, without: Calibration) -> Plant:
    """Return the plant fitted without the new effects, with the smallest strength of them that `_otherwise` tries."""
    bare = without.plant.with_rig(start.rig)  # with the same model error
    return with_fitted(bare, _stronger(start, without, min(OTHERWISE, key=abs)) or start)


def _otherwise(trial: Trial) -> Iterator[Plant]:
    """Yield the plant with other strengths of its new effects, within their ranges."""
    for share in OTHERWISE:
        moved = _stronger(trial.start, trial.without, share)
        if moved is not None:
            yield moved


def _stronger(plant: Plant, without: Calibration, share: float) -> Plant | None:
    """Return the plant with a share of the strengths of its new effects; None if none is within its range."""
    before = without.plant.effect_names
    new = [plant.parameters[f"{e.name}.{e.strength}"] for e in plant.effects if e.name not in before]
    moved = {p.name: share * p.value for p in new if p.lower <= share * p.value <= p.upper}
    return plant.with_values(moved) if moved else None
