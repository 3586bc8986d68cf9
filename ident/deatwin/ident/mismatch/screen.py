"""What an effect could explain, to first order in its strength: one simulation each, no fit."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, Problem
from deatwin.plant.effects.base import Effect
from deatwin.plant.parameters import Scale

__all__ = ["detectable_size", "screened", "strength_direction"]

SHAPES = 3
"""Values of each shape parameter at which an effect is screened,"""
SHAPE_RANGE = (1 / 8, 8.0)
"""over this range of its typical value."""


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
