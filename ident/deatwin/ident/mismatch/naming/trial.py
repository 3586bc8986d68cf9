"""One trial: effects are built into the plant, and the whole is fitted anew and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.status import FitStatus
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import (
    DECIDING,
    ROUGH,
    ROUGHLY,
    at_its_time,
    finish,
    further,
    in_a_wider_range,
    in_its_gap,
    is_promising,
    roughly,
    search,
)
from deatwin.ident.parallel import run_jobs, stream_jobs
from deatwin.plant.model import Plant

FAILED_SEARCH = 1.02
"""A fit that leaves more than was promised, by more than this ratio of the rms, has lost its way."""
FEW = 4
"""Simulations that show whether the way from the biased plant leads anywhere."""
NEAR = 1.1
"""Fits that are within this ratio of the best rms, or by their linearised minimum were on the way there when they ran
out of simulations, are carried to the end, besides those that leave hardly anything."""
HOPELESS = 1.5
"""A fit is given up where its linearised minimum is above the rms of another one by this ratio. At the first point of
a fit to all samples that is mostly within 15 % of where it ends."""
MOSTLY = 0.5
"""A fit is not given up that leaves less than this share of the mean square without its last effect."""
FIRST = 2
"""Trials that are made before the others, which must come near to the best of them."""
OTHERWISE = (-1.0, 0.1, 1e-3)
"""Shares of the strength of the new effect with which a fit begins, where it cannot with all of it."""
Fitted = Callable[[Calibration, np.ndarray | None], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Start of the fit of a set of effects.

    Parameters
    ----------
    start : Plant
        With the effects, and values that were not biased by a fit without them.
    biased : Plant
        With the effects, and the values of the best plant without the last of them: another start.
    without : Calibration
        That plant's fit, of which this one is a generalisation.
    share : float
        Of that fit's squared residual, what the last effect explains to first order; 0 if unknown.
    """

    start: Plant
    biased: Plant
    without: Calibration
    share: float = 0.0

    @property
    def promised(self) -> float:
        """Rms that the fit should leave at most, SI: to first order; without the effect, where that says nothing."""
        return self.without.rms * float(np.sqrt(max(1.0 - self.share, 0.0)))


def trials_of(unbiased: Plant, fit: Calibration, chosen: Iterable[Lead]) -> list[Trial]:
    """Trials of single effects.

    Parameters
    ----------
    unbiased : Plant
        Without them, not biased by a fit.
    fit : Calibration
        Of the plant without them.
    chosen : iterable of Lead
        The effects.

    Returns
    -------
    list of Trial
        Each effect built into the unbiased plant, and as it is estimated into the one that the fit biased.
    """
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
    """Fit and judge each trial, those that promise most first; one that cannot come near another is given up.

    Parameters
    ----------
    problem : DiagnosisProblem
        Recordings and number of workers.
    trials : sequence of Trial
        What to try; the first ones give the others their measure.
    noise : float
        Standard deviation of the sensor's noise, SI.
    finished : callable, optional
        Called with the share that is done.
    fitted : callable, optional
        Called with each fit as soon as there is one; with its residuals on the held-out part, SI, once they are known.
    alternative : float
        Rms of the best fit so far that these compete with, SI.

    Returns
    -------
    list of Candidate
        In the order of the trials, without those whose plant cannot be simulated.
    """
    fits: list[Calibration] = []
    done = 0
    first = FIRST if np.isinf(alternative) else len(trials)  # a measure that is known need not be waited for
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
        alternative = min([alternative, *(fit.rms for fit in fits)])
    near = [k for k, fit in enumerate(fits) if fit.within_reach < NEAR * alternative or is_promising(fit, noise)]
    longest_first = sorted(range(len(fits)), key=lambda k: k not in near)
    jobs = [(problem, fits[k], noise, k in near) for k in longest_first]
    ended = dict(zip(longest_first, run_jobs(_ended, jobs, workers=problem.jobs), strict=True))
    return _told([ended[k] for k in range(len(fits))], fitted)


def refitted(
    problem: DiagnosisProblem, plants: Sequence[Plant], noise: float, fitted: Fitted | None = None
) -> list[Candidate]:
    """Fit plants from where they are, to the end, and judge them.

    Parameters
    ----------
    problem : DiagnosisProblem
        Recordings and number of workers.
    plants : sequence of Plant
        With effects, and values from another fit.
    noise, fitted
        As for `run_trials`.

    Returns
    -------
    list of Candidate
        In their order, without those that cannot be simulated.
    """
    return _told(run_jobs(_from_there, [(problem, plant, noise) for plant in plants], workers=problem.jobs), fitted)


def _told(judged: Sequence[Candidate | None], fitted: Fitted | None) -> list[Candidate]:
    candidates = [candidate for candidate in judged if candidate is not None]
    if fitted is not None:
        for candidate in candidates:
            fitted(candidate.calibration, candidate.unseen)
    return candidates


def with_fitted(nominal: Plant, fitted: Plant) -> Plant:
    """The nominal plant with another one's effects and their values.

    Parameters
    ----------
    nominal : Plant
        Not biased by a fit.
    fitted : Plant
        Has all effects of the nominal one.

    Returns
    -------
    Plant
    """
    added = [effect for effect in fitted.effects if effect.name not in nominal.effect_names]
    own = {p.name: fitted.parameters[p.name].value for effect in added for p in effect.parameters}
    return nominal.with_effects(*added).with_values(own)


def unbiased_like(problem: DiagnosisProblem, fitted: Plant) -> Plant:
    """The nominal plant in the variant of a fitted one, with its effects and their values: the rest was not biased.

    Parameters
    ----------
    problem : DiagnosisProblem
        With the nominal plant.
    fitted : Plant
        Perhaps in another variant.

    Returns
    -------
    Plant
    """
    return with_fitted(problem.nominal.with_rig(fitted.rig), fitted)


def _tried(problem: DiagnosisProblem, trial: Trial, hopeless: float) -> Calibration:
    """From the unbiased plant; where that does not keep what is promised, from the biased one as well.

    A plant that was fitted without an effect has been biased to imitate it, and the way back is long; but what the score
    promises is near it, where a search from afar may end elsewhere. From where all is as without the new effects, but
    for a little of them, no fit leaves more than without them: from there goes what left more. Where neither can be
    simulated, from the unbiased plant with the effect the other way or with less of it: a softening spring lets go of the
    ball, a hardening one or a little of it does not.
    """
    found = search(trial.start, problem.fitted, hopeless)
    if found.given_up and found.rms**2 < MOSTLY * trial.without.rms**2:
        found = _better(found, further(found, problem.fitted, **ROUGHLY))  # from afar the linearised minimum errs most
    # The plant without the effect is a special case of the one with it: a worse fit is a failed search.
    if not found.status.ok or found.rms > FAILED_SEARCH * trial.promised:
        again = descend(trial.biased, problem.fitted, evaluations=FEW, tolerance=ROUGH, hopeless=hopeless)
        if again.status is FitStatus.STOPPED and _better(found, again) is again:
            again = _better(again, further(again, problem.fitted, **ROUGHLY, hopeless=hopeless))
        found = _better(found, again)
    if found.status.ok and not found.given_up and found.rms > FAILED_SEARCH * trial.without.rms:
        found = _better(found, roughly(_with_little(trial), problem.fitted, hopeless))
    for start in _otherwise(trial):
        if found.status.ok:
            break
        found = search(start, problem.fitted, hopeless)
    if not found.status.ok:
        return found
    placed = at_its_time(found, problem.fitted, hopeless, ROUGH)
    return in_a_wider_range(placed, trial.start, problem.fitted, hopeless)


def _from_there(problem: DiagnosisProblem, plant: Plant, noise: float) -> Candidate | None:
    """A plant fitted from its values; from far away where these cannot be simulated without what else was there."""
    found = roughly(plant, problem.fitted)
    found = found if found.status.ok else search(plant, problem.fitted)
    return _ended(problem, found, noise, True) if found.status.ok else None


def _ended(problem: DiagnosisProblem, fit: Calibration, noise: float, to_the_end: bool) -> Candidate | None:
    """A fit, carried to the end or as it is, and judged."""
    return judge(problem, _finished(problem, fit) if to_the_end else fit, noise)


def _finished(problem: DiagnosisProblem, fit: Calibration) -> Calibration:
    """The fit carried to the end, with an event that it cannot place where the held-out part has it."""
    placed = at_its_time(fit, problem.fitted, enough=DECIDING)
    return in_its_gap(finish(placed, problem.fitted), problem.fitted, problem.everything)


def _better(one: Calibration, other: Calibration) -> Calibration:
    """The fit that leaves less; the other where one failed."""
    return other if other.status.ok and (not one.status.ok or other.rms < one.rms) else one


def _with_little(trial: Trial) -> Plant:
    """The plant that was fitted without the new effects, with the least of them that `_otherwise` tries."""
    without = trial.without.plant.with_rig(trial.start.rig)  # to be judged by the same model error
    return with_fitted(without, _stronger(trial, min(OTHERWISE, key=abs)) or trial.start)


def _otherwise(trial: Trial) -> Iterator[Plant]:
    """The plant with other strengths of the effects that are new in it, as far as they are in their ranges."""
    for share in OTHERWISE:
        moved = _stronger(trial, share)
        if moved is not None:
            yield moved


def _stronger(trial: Trial, share: float) -> Plant | None:
    """The plant with a share of the strengths of the effects that are new in it; None where none is in its range."""
    plant, before = trial.start, trial.without.plant.effect_names
    new = [plant.parameters[f"{e.name}.{e.strength}"] for e in plant.effects if e.name not in before]
    moved = {p.name: share * p.value for p in new if p.lower <= share * p.value <= p.upper}
    return plant.with_values(moved) if moved else None
