"""Which missing physics explains a mismatch: each effect is built into the plant and the whole is fitted anew."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, Problem
from deatwin.ident.mismatch.detect import Detection, detect
from deatwin.ident.mismatch.losses import block_losses, evidence
from deatwin.ident.mismatch.search import search
from deatwin.ident.parallel import run_jobs
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Scale

__all__ = [
    "Candidate",
    "Naming",
    "detectable_size",
    "fit_candidate",
    "free_run_residuals",
    "judge",
    "screened",
    "try_pairs",
    "try_singles",
]

SHAPES = 3
"""Values of each shape parameter at which an effect is screened,"""
SHAPE_RANGE = (1 / 8, 8.0)
"""over this range of its typical value."""
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
        Their canonical names; empty for the base plant.
    calibration : Calibration
        The fit.
    unseen : ndarray, shape (n,)
        Residuals on the unseen part, SI.
    fitted_test, unseen_test : Detection
        Whether what is left is more than noise and model error.
    """

    effects: tuple[str, ...]
    calibration: Calibration
    unseen: np.ndarray
    fitted_test: Detection
    unseen_test: Detection

    @property
    def mismatch(self) -> bool:
        """Whether it certainly leaves more than noise and model error, on the fitted or on the unseen part."""
        return self.fitted_test.mismatch or self.unseen_test.mismatch

    @property
    def adequate(self) -> bool:
        """Whether what it leaves is no larger than noise and model error, on either part.

        That is more than the absence of a significant mismatch: an explanation has to explain.
        """
        return self.fitted_test.within_floor and self.unseen_test.within_floor

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
    """

    candidates: tuple[Candidate, ...]
    best: Candidate | None
    rivals: tuple[Candidate, ...]
    probabilities: dict[tuple[str, ...], float]


def screened(base: Calibration, effect: Effect, parts: Sequence[Part]) -> Effect:
    """An effect with the shape and the sign that a score test finds most promising.

    For each of a few shapes the derivative of the readings by the strength, at strength zero, is projected off
    the base plant's Jacobian; the residual's share along it says how much the effect could explain, to first
    order. The strength itself starts at its typical size: the base plant has absorbed part of the effect.

    Parameters
    ----------
    base : Calibration
        Of the plant without the effect, on the same parts.
    effect : Effect
        To be tried.
    parts : sequence of Part
        The fitted part.

    Returns
    -------
    Effect
        With its starting values.

    References
    ----------
    Rao's score test, Proc. Camb. Phil. Soc. 44 (1948) 50, doi:10.1017/S0305004100023987.
    """
    shapes = _shapes(effect)
    strength = next(p for p in effect.describe() if p.name == effect.strength)
    if len(shapes) == 1 and strength.lower >= 0.0:
        return effect
    residual = base.residuals
    best, best_score = effect, 0.0
    for shaped in shapes:
        direction = strength_direction(base, shaped, parts)
        if direction is None:
            continue
        along = float(direction @ residual) / max(float(np.linalg.norm(direction)), 1e-300)
        sign = 1.0 if strength.lower >= 0.0 else float(np.sign(along) or 1.0)
        if sign * along > best_score:
            best = replace(shaped, **{effect.strength: sign * abs(strength.value)})
            best_score = sign * along
    return best


def strength_direction(base: Calibration, effect: Effect, parts: Sequence[Part]) -> np.ndarray | None:
    """What the base refit leaves of an effect's first-order contribution to the readings.

    Parameters
    ----------
    base : Calibration
        Of the plant without the effect.
    effect : Effect
        Its shape parameters count.
    parts : sequence of Part
        On which the base was fitted.

    Returns
    -------
    ndarray, shape (m,), or None
        Derivative by the strength at strength zero, projected off the base plant's Jacobian; None if the plant
        cannot be simulated.
    """
    found = _strength_derivative(base, effect, parts)
    return None if found is None else _off_base(base, found)


def detectable_size(base: Calibration, effect: Effect, parts: Sequence[Part]) -> float | None:
    """Rms that an effect must add to the readings to be detected after the base refit.

    Parameters
    ----------
    base : Calibration
        Of the plant without the effect.
    effect : Effect
        Its shape parameters count.
    parts : sequence of Part
        On which the base was fitted.

    Returns
    -------
    float or None
        SI; what the refit leaves of it equals the model error, to first order in the strength. None where the
        refit absorbs it all, or the plant cannot be simulated.
    """
    derivative = _strength_derivative(base, effect, parts)
    if derivative is None:
        return None
    left = _off_base(base, derivative)
    share = float(np.linalg.norm(left) / max(float(np.linalg.norm(derivative)), 1e-300))
    return base.plant.rig.model_error / share if share > 1e-6 else None


def _off_base(base: Calibration, direction: np.ndarray) -> np.ndarray:
    """What is left of a direction when the base plant's parameters take up all they can."""
    basis, _ = np.linalg.qr(base.jacobian / np.linalg.norm(base.jacobian, axis=0))
    return direction - basis @ (basis.T @ direction)


def _strength_derivative(base: Calibration, effect: Effect, parts: Sequence[Part]) -> np.ndarray | None:
    plant = base.plant.with_effects(replace(effect, **{effect.strength: 0.0}))
    problem = Problem(plant=plant, parts=tuple(parts), names=(f"{effect.name}.{effect.strength}",))
    found = problem.evaluate(problem.start())
    return None if found is None else found[1][:, 0]


def fit_candidate(
    nominal: Plant, base: Calibration, effect: Effect, fitted: Sequence[Part], unseen: Sequence[Part], noise: float
) -> Candidate | None:
    """Build an effect into a plant, fit the whole anew, and judge it.

    Parameters
    ----------
    nominal : Plant
        Where the fit starts: a base plant that was fitted without the effect has been bent to imitate it, and
        the way back is long.
    base : Calibration
        The fitted plant without the effect, for the effect's starting shape, and where to start if the way from
        the nominal plant leads nowhere.
    effect : Effect
        To be added.
    fitted, unseen : sequence of Part
        What is fitted, and what only judges.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Candidate or None
        None if the plant with the effect cannot be simulated.
    """
    start = screened(base, effect, fitted)
    calibration = search(nominal.with_effects(start), fitted, noise)
    if not calibration.status.ok or calibration.rms > FAILED_SEARCH * base.rms:
        # The plant without the effect is a special case of the one with it: a worse fit is a failed search.
        again = search(base.plant.with_effects(start), fitted, noise)
        calibration = again if again.status.ok else calibration
    return judge(calibration, unseen, noise) if calibration.status.ok else None


def judge(calibration: Calibration, unseen: Sequence[Part], noise: float) -> Candidate | None:
    """Free-run residuals of a fitted plant on the unseen part.

    Parameters
    ----------
    calibration : Calibration
        The fit.
    unseen : sequence of Part
        What only judges.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Candidate or None
        None if the plant cannot be simulated there.
    """
    residuals = free_run_residuals(calibration.plant, unseen)
    if residuals is None:
        return None
    model_error = calibration.plant.rig.model_error
    return Candidate(
        effects=calibration.plant.effect_names, calibration=calibration, unseen=residuals,
        fitted_test=detect(calibration.residuals, noise, model_error),
        unseen_test=detect(residuals, noise, model_error),
    )  # fmt: skip


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
    pieces = []
    for part in parts:
        simulation = plant.simulate(part.experiment)
        if not simulation.status.ok:
            return None
        pieces += [y[0, m] for y, m in zip(simulation.outputs, part.masks, strict=True)]
    return np.concatenate([part.measured for part in parts]) - np.concatenate(pieces)


def try_singles(
    nominal: Plant, base: Candidate, effects: Sequence[Effect], fitted: Sequence[Part], unseen: Sequence[Part], *,
    noise: float, jobs: int = 1, finished: Callable[[float], None] | None = None,
) -> Naming:
    """Build each effect alone into the base plant.

    Parameters
    ----------
    nominal : Plant
        Where each fit starts.
    base : Candidate
        The calibrated plant without effects.
    effects : sequence of Effect
        The catalogue.
    fitted, unseen : sequence of Part
        What is fitted, and what only judges.
    noise : float
        Standard deviation of the sensor's noise, SI.
    jobs : int
        Worker processes.
    finished : callable, optional
        Called with the share that is done.

    Returns
    -------
    Naming
    """
    tasks = [(nominal, base.calibration, effect, fitted, unseen, noise) for effect in effects]
    singles = _try(tasks, jobs, finished)
    return _decide((base, *singles), singles)


def try_pairs(
    nominal: Plant, naming: Naming, effects: Sequence[Effect], fitted: Sequence[Part], unseen: Sequence[Part], *,
    noise: float, jobs: int = 1, finished: Callable[[float], None] | None = None,
) -> Naming:
    """Build each other effect into the best plant with a single one.

    Parameters
    ----------
    nominal : Plant
        Where each fit starts, with the single effect as it was fitted.
    naming : Naming
        What `try_singles` found.
    effects, fitted, unseen, noise, jobs, finished
        As there.

    Returns
    -------
    Naming
        Over the pairs, with all that was tried before in `candidates`.
    """
    singles = [c for c in naming.candidates if len(c.effects) == 1]
    if not singles:
        return naming
    one = max(singles, key=lambda c: c.evidence)
    start = _with_fitted(nominal, one.calibration.plant)
    others = [effect for effect in effects if effect.name not in one.effects]
    tasks = [(start, one.calibration, effect, fitted, unseen, noise) for effect in others]
    pairs = _try(tasks, jobs, finished)
    return _decide((*naming.candidates, *pairs), pairs)


def _try(tasks: list[Any], jobs: int, finished: Callable[[float], None] | None) -> list[Candidate]:
    def count(done: int) -> None:
        if finished is not None:
            finished(done / len(tasks))

    found = run_jobs(fit_candidate, tasks, workers=jobs, finished=count)
    return [candidate for candidate in found if candidate is not None]


def _with_fitted(nominal: Plant, fitted: Plant) -> Plant:
    """The nominal plant with another one's effects and their values."""
    own = {p.name: fitted.parameters[p.name].value for effect in fitted.effects for p in effect.parameters}
    return nominal.with_effects(*fitted.effects).with_values(own)


def _decide(tried: Sequence[Candidate], stage: Sequence[Candidate]) -> Naming:
    """The best of one stage, and the ones that cannot be ruled out beside it."""
    ranked = sorted(stage, key=lambda c: -c.evidence)
    weights = np.exp([c.evidence - ranked[0].evidence for c in ranked]) if ranked else np.empty(0)
    probabilities = {c.effects: float(w) for c, w in zip(ranked, weights / weights.sum(), strict=True)} if ranked else {}
    adequate = [c for c in ranked if c.adequate]
    if not adequate:
        return Naming(candidates=tuple(tried), best=None, rivals=(), probabilities=probabilities)
    best = adequate[0]
    rivals = tuple(c for c in adequate[1:] if _cannot_rule_out(c, best))
    return Naming(candidates=tuple(tried), best=best, rivals=rivals, probabilities=probabilities)


def _cannot_rule_out(rival: Candidate, best: Candidate) -> bool:
    if best.evidence - rival.evidence < np.log(EVIDENCE_RATIO):
        return True
    apart = np.sqrt(max(rival.losses.mean() - best.losses.mean(), 0.0))
    return bool(apart < RIVAL_SHARE * best.calibration.plant.rig.model_error)


def _shapes(effect: Effect) -> list[Effect]:
    """The effect over a grid of each shape parameter, inside its range and around its typical value."""
    grids = []
    for parameter in effect.describe():
        if parameter.name == effect.strength:
            continue
        low, high = (float(np.clip(parameter.value * f, parameter.lower, parameter.upper)) for f in SHAPE_RANGE)
        values = np.geomspace(low, high, SHAPES) if parameter.scale is Scale.LOGARITHMIC else [parameter.value]
        grids.append([(parameter.name, float(v)) for v in values])
    return [replace(effect, **dict(combination)) for combination in itertools.product(*grids)]
