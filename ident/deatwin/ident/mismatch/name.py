"""Which missing physics explains a mismatch: each effect is built into the plant and the whole is fitted anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, simulated
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.excess import Excess, excess_over_floor
from deatwin.ident.mismatch.floor import floor_of, with_model_error
from deatwin.ident.mismatch.losses import block_losses, evidence
from deatwin.ident.mismatch.noise import noise_floor
from deatwin.ident.mismatch.screen import Footprint, Lead, footprints, leads
from deatwin.ident.mismatch.search import at_its_time, search
from deatwin.ident.mismatch.shortlist import shortlist
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant

__all__ = [
    "Candidate",
    "Naming",
    "fit_candidate",
    "free_run_residuals",
    "judge",
    "noise_seen",
    "try_pairs",
    "try_singles",
]

FAILED_SEARCH = 1.02
"""A fit whose error is larger than the plant's without the effect by more than this has lost its way."""
EVIDENCE_RATIO = 20.0
"""An explanation stands alone where no rival is within this ratio (Kass & Raftery 1995: strong evidence)."""
RIVAL_SHARE = 0.5
"""A rival is also kept while its error differs from the best by less than this share of the model error."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A plant with a set of effects, fitted to the fitted part and judged on the unseen one.

    Parameters
    ----------
    effects : tuple of str
        Canonical names of the effects that were added to the plant on the bench; none for the base.
    calibration : Calibration
        The fit.
    unseen : ndarray, shape (n,)
        Residuals on the unseen part, SI.
    noise : float
        Standard deviation of the sensor's noise by which it is judged, SI.
    """

    effects: tuple[str, ...]
    calibration: Calibration
    unseen: np.ndarray
    noise: float

    @cached_property
    def fitted_test(self) -> Excess:
        """Whether what is left of the fitted part is more than noise and model error."""
        return excess_over_floor(self.calibration.residuals, self.noise, self.calibration.plant.rig.model_error)

    @cached_property
    def unseen_test(self) -> Excess:
        """The same of the unseen part."""
        return excess_over_floor(self.unseen, self.noise, self.calibration.plant.rig.model_error)

    def with_floor(self, model_error: float) -> Candidate:
        """The same candidate, judged by another model error.

        Parameters
        ----------
        model_error : float
            Rms, SI.

        Returns
        -------
        Candidate
        """
        plant = with_model_error(self.calibration.plant, model_error)
        return replace(self, calibration=replace(self.calibration, plant=plant))

    @property
    def mismatch(self) -> bool:
        """Whether it certainly leaves more than noise and model error, on the fitted or on the unseen part."""
        return self.fitted_test.mismatch or self.unseen_test.mismatch

    @property
    def adequate(self) -> bool:
        """Whether it explains the recordings.

        What it leaves of the fitted part must be no larger than noise and model error, which is more than the
        absence of a significant mismatch; the unseen part, which is extrapolated, must not refute it.
        """
        return self.fitted_test.within_floor and not self.unseen_test.mismatch

    @property
    def losses(self) -> np.ndarray:
        """Block losses over both parts."""
        return np.concatenate([block_losses(self.calibration.residuals), block_losses(self.unseen)])

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence over both parts."""
        return evidence(self.losses, len(self.calibration.names))


@dataclass(frozen=True, kw_only=True, eq=False)
class Naming:
    """All explanations that were tried.

    Parameters
    ----------
    candidates : tuple of Candidate
        All that could be fitted, in the order in which they were tried.
    best : Candidate or None
        The adequate explanation with the most evidence.
    rivals : tuple of Candidate
        Other adequate ones that these recordings cannot rule out.
    probabilities : mapping of tuple of str to float
        Of each candidate of the size of the best one, by evidence.
    failed : tuple of str
        Effects and pairs that could not be tried, since no fit with them could be simulated; that is no evidence
        against them.
    noise : float
        Standard deviation of the sensor's noise, as the best explanation shows it, SI.
    """

    candidates: tuple[Candidate, ...]
    best: Candidate | None
    rivals: tuple[Candidate, ...]
    probabilities: dict[tuple[str, ...], float]
    noise: float
    failed: tuple[str, ...] = ()


def fit_candidate(
    bench: Bench, nominal: Plant, base: Calibration, effect: Effect, noise: float
) -> Candidate | None:
    """Build an effect into a plant, fit the whole anew, and judge it.

    Parameters
    ----------
    bench : Bench
        Recordings.
    nominal : Plant
        Where the fit starts: a base plant that was fitted without the effect has been bent to imitate it, and
        the way back is long.
    base : Calibration
        The fitted plant without the effect: where to start if the way from the nominal plant leads nowhere.
    effect : Effect
        To be added, with the shape and strength to start from.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Candidate or None
        None if the plant with the effect cannot be simulated.
    """
    calibration = search(nominal.with_effects(effect), bench.fitted, noise)
    if not calibration.status.ok or calibration.rms > FAILED_SEARCH * base.rms:
        # The plant without the effect is a special case of the one with it: a worse fit is a failed search.
        again = search(base.plant.with_effects(effect), bench.fitted, noise)
        calibration = again if again.status.ok else calibration
    if calibration.status.ok:
        calibration = at_its_time(calibration, bench.fitted, noise)
    return judge(bench, calibration, noise) if calibration.status.ok else None


def judge(bench: Bench, calibration: Calibration, noise: float) -> Candidate | None:
    """Free-run residuals of a fitted plant on the unseen part.

    Parameters
    ----------
    bench : Bench
        Recordings.
    calibration : Calibration
        The fit.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Candidate or None
        None if the plant cannot be simulated there.
    """
    residuals = free_run_residuals(calibration.plant, bench.unseen)
    if residuals is None:
        return None
    added = tuple(e for e in calibration.plant.effect_names if e not in bench.nominal.effect_names)
    return Candidate(effects=added, calibration=calibration, unseen=residuals, noise=noise)


def free_run_residuals(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Measured minus simulated at the samples that count.

    Parameters
    ----------
    plant : Plant
        Simulated from rest.
    parts : sequence of Part
        Which samples.

    Returns
    -------
    ndarray, shape (n,), or None
        SI; None if the plant fails.
    """
    readings = simulated(plant, parts)
    return None if readings is None else np.concatenate([part.measured for part in parts]) - readings


def try_singles(
    bench: Bench,
    base: Candidate,
    known: Sequence[Footprint],
    noise: float,
    finished: Callable[[float], None] | None = None,
) -> Naming:
    """Build each promising effect alone into the base plant.

    Parameters
    ----------
    bench : Bench
        Effects and recordings.
    base : Candidate
        The calibrated plant without effects, in the form of the rig that is to be used.
    known : sequence of Footprint
        Of all effects in that plant.
    noise : float
        Standard deviation of the sensor's noise, SI.
    finished : callable, optional
        Called with the share that is done.

    Returns
    -------
    Naming
    """
    nominal = bench.nominal.with_rig(base.calibration.plant.rig)
    promising = shortlist(bench, nominal, leads(known, base.calibration))
    tasks = [(bench, nominal, base.calibration, effect, noise) for effect in promising]
    singles = _try(tasks, bench.jobs, finished)
    noise = _quietest(bench, singles, noise)
    singles = [replace(c, noise=noise) for c in singles]
    if singles:
        # The base plant was bent to imitate what is missing; the best explanation knows the plant's own error better.
        best = max(singles, key=lambda c: c.evidence)
        error = max(nominal.rig.model_error, floor_of(best.calibration.plant, bench))
        singles = [c.with_floor(error) for c in singles]
    tried = {name for single in singles for name in single.effects}
    seen = {footprint.effect.name for footprint in known}
    untried = {e.name for e in promising} - tried
    failed = tuple(e.name for e in bench.effects if e.name in untried or e.name not in seen)
    return replace(_decide((replace(base, noise=noise), *singles), singles, noise), failed=failed)


def try_pairs(
    bench: Bench,
    known: Sequence[Footprint],
    naming: Naming,
    finished: Callable[[float], None] | None = None,
) -> Naming:
    """Build each other promising effect into the best plant with a single one.

    Parameters
    ----------
    bench : Bench
        Effects and recordings.
    known : sequence of Footprint
        Of all effects in the base plant.
    naming : Naming
        What `try_singles` found.
    finished : callable, optional
        Called with the share that is done.

    Returns
    -------
    Naming
        Over the pairs, with all that was tried before in `candidates`.
    """
    singles = [c for c in naming.candidates if len(c.effects) == 1]
    if not singles:
        return naming
    one = max(singles, key=lambda c: c.evidence).calibration
    start = _with_fitted(bench.nominal.with_rig(one.plant.rig), one.plant)
    others = shortlist(bench, start, _leads_beside(bench, known, naming.candidates[0].calibration, one))
    tasks = [(bench, start, one, effect, naming.noise) for effect in others]
    pairs = _try(tasks, bench.jobs, finished)
    noise = _quietest(bench, pairs, naming.noise)
    pairs = [replace(c, noise=noise) for c in pairs]
    before = [replace(c, noise=noise) for c in naming.candidates]
    tried = {name for pair in pairs for name in pair.effects}
    failed = tuple("+".join((*one.plant.effect_names, e.name)) for e in others if e.name not in tried)
    counting = [pair for pair in pairs if _each_counts(pair, before)]
    decided = _decide((*before, *pairs), counting, noise)
    single = next(c for c in before if c.calibration is one)
    idle = [pair for pair in pairs if pair.adequate]
    if decided.best is None and idle and single.fitted_test.within_floor:
        # The second effect only takes up what the plant's own error leaves: it is a rival, not a cause.
        decided = replace(_decide((*before, *pairs), [single, *idle], noise), best=single, rivals=tuple(idle))
    return replace(decided, failed=(*naming.failed, *failed))


def _leads_beside(
    bench: Bench, known: Sequence[Footprint], base: Calibration, one: Calibration
) -> tuple[Lead, ...]:
    """What the other effects could explain of what a plant with a single one leaves."""
    free = [effect for effect in bench.effects if effect.name not in one.plant.effect_names]
    looking = [e for e in free if e.starts(np.concatenate([p.timepts for p in bench.fitted]), one.residuals)]
    again = footprints(bench, base, looking, one)
    names = {e.name for e in free} - {e.name for e in looking}
    kept = [f for f in known if f.effect.name in names]
    return leads([*kept, *again], one)


def _try(tasks: list[Any], jobs: int, finished: Callable[[float], None] | None) -> list[Candidate]:
    def count(done: int) -> None:
        if finished is not None:
            finished(done / len(tasks))

    found = run_jobs(fit_candidate, tasks, workers=jobs, finished=count)
    return [candidate for candidate in found if candidate is not None]


def _each_counts(pair: Candidate, tried: Sequence[Candidate]) -> bool:
    """Whether the error grows by more than the model error when either effect is taken out."""
    losses = {c.effects: float(c.losses.mean()) for c in tried}
    model_error = pair.calibration.plant.rig.model_error
    for effect in pair.effects:
        rest = tuple(e for e in pair.effects if e != effect)
        without = losses.get(rest, losses[()])
        if without - float(pair.losses.mean()) < model_error**2:
            return False
    return True


def _with_fitted(nominal: Plant, fitted: Plant) -> Plant:
    """The nominal plant with another one's effects and their values."""
    added = [effect for effect in fitted.effects if effect.name not in nominal.effect_names]
    own = {p.name: fitted.parameters[p.name].value for effect in added for p in effect.parameters}
    return nominal.with_effects(*added).with_values(own)


def noise_seen(fit: Calibration, parts: Sequence[Part]) -> float:
    """The sensor's noise as the residuals of a fit show it.

    Parameters
    ----------
    fit : Calibration
        On `parts`.
    parts : sequence of Part
        What was fitted.

    Returns
    -------
    float
        Standard deviation, SI; never below the data sheet's.
    """
    sizes = [int(mask.sum()) for part in parts for mask in part.masks if mask.any()]
    pieces = np.split(fit.residuals, np.cumsum(sizes)[:-1])
    return noise_floor(pieces, fit.plant.rig.sample_time, fit.plant.rig.noise)


def _quietest(bench: Bench, candidates: Sequence[Candidate], noise: float) -> float:
    """What a wrong plant leaves at the top of the spectrum is no noise: the best explanation shows the least."""
    return min([noise, *(noise_seen(c.calibration, bench.fitted) for c in candidates)])


def _decide(tried: Sequence[Candidate], stage: Sequence[Candidate], noise: float) -> Naming:
    """The best of one stage, and the ones that cannot be ruled out beside it."""
    ranked = sorted(stage, key=lambda c: -c.evidence)
    weights = np.exp([c.evidence - ranked[0].evidence for c in ranked])
    probabilities = {c.effects: float(w / weights.sum()) for c, w in zip(ranked, weights, strict=True)}
    adequate = [c for c in ranked if c.adequate]
    best = adequate[0] if adequate else None
    rivals = tuple(c for c in adequate[1:] if best is not None and _cannot_rule_out(c, best))
    return Naming(candidates=tuple(tried), best=best, rivals=rivals, probabilities=probabilities, noise=noise)


def _cannot_rule_out(rival: Candidate, best: Candidate) -> bool:
    if best.evidence - rival.evidence < np.log(EVIDENCE_RATIO):
        return True
    apart = np.sqrt(max(rival.losses.mean() - best.losses.mean(), 0.0))
    return bool(apart < RIVAL_SHARE * best.calibration.plant.rig.model_error)
