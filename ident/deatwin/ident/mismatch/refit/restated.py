"""One number of the rig file that is wrong: the only change that the recordings need, if they need no effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import Field, fields, replace
from math import isfinite
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import free_run_residuals, motion_of
from deatwin.ident.mismatch.likelihood.beforehand import DATA_SHEET
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import EVALUATIONS
from deatwin.ident.mismatch.thresholds import ACCURACY, FEW, NEGLIGIBLE
from deatwin.plant.errors import DeatwinError
from deatwin.plant.model import Plant
from deatwin.plant.rigfaults import users_code
from deatwin.plant.rigs.base import Rig

FARTHEST = float(np.log(3.0))
"""Largest logarithm of the factor by which a number may change: a diameter in place of a radius is a factor of two, and
steps may pass it."""
NEAR = DATA_SHEET
"""Largest step of this logarithm, within which the readings are nearly linear in it."""
STEP, SETTLED = 0.01, 1e-4
"""Change of the logarithm for a difference quotient, and the step at which it counts as found."""
ROUNDS = 8
"""Largest number of steps."""


def stated_numbers(rig: Rig) -> Mapping[str, float]:
    """Return the numbers other than zero that a rig adds to those of every rig, by the names of its fields."""
    shared = {field.name for field in fields(Rig)} | {"direction"}
    own = {field: getattr(rig, field.name) for field in fields(rig) if field.init and field.name not in shared}
    return {field.name: float(value) for field, value in own.items() if _is_number(field, value) and value}


def _is_number(field: Field[Any], value: Any) -> bool:
    """Return whether a value is a finite number and no count; a number may be written without a decimal point."""
    declared = getattr(field.type, "__name__", field.type).split(" | ")
    whole = isinstance(value, int) and not isinstance(value, bool) and "float" in declared
    return (whole or isinstance(value, float)) and isfinite(value)


def restated(problem: DiagnosisProblem, base: Candidate) -> Iterator[Candidate]:
    """Yield the base plant with one stated number changed, for each that explains the recordings, likely ones first."""
    fit, error = base.calibration, problem.nominal.rig.model_error
    if not fit.plant.rig.equations_known:
        return
    steps = {name: _step(fit, problem, name) for name in stated_numbers(fit.plant.rig)}
    promising = sorted((left, name) for name, (_, left) in steps.items() if left < fit.rms)
    for _, name in promising[:FEW]:
        found = _fitted(fit, problem, name, steps[name][0])
        candidate = None if found is None else judge(problem, found, base.noise)
        if candidate is not None and candidate.with_floor(error).adequate:
            yield candidate.with_floor(error)


def _fitted(fit: Calibration, problem: DiagnosisProblem, name: str, step: float) -> Calibration | None:
    """Fit the plant together with one stated number, by Gauss-Newton steps of its logarithm, halved at limits."""
    whole = 0.0
    for _ in range(ROUNDS):
        step = float(np.clip(step, -NEAR, NEAR))
        if abs(whole + step) > FARTHEST:
            return None
        moved = _with_number(fit, problem, name, step)
        if moved is None:
            step /= 2
            continue
        fit, whole = moved, whole + step
        if abs(step) < SETTLED:
            break
        step, _ = _step(fit, problem, name)
    return fit


def _with_number(fit: Calibration, problem: DiagnosisProblem, name: str, step: float) -> Calibration | None:
    """Calibrate the plant with a step of one number's logarithm; None if the rig forbids it or cannot be simulated."""
    try:
        found = descend(_other(fit.plant, name, step), problem.fitted, evaluations=EVALUATIONS, tolerance=NEGLIGIBLE)
    except DeatwinError:
        return None
    return found if found.status.ok else None


def _other(plant: Plant, name: str, step: float) -> Plant:
    """Return a plant after a step of one number's logarithm; DeatwinError if the rig does not allow that number."""
    with users_code(f"the rig {plant.rig.kind}"):
        return plant.with_rig(replace(plant.rig, **{name: float(np.exp(step)) * getattr(plant.rig, name)}))


def _step(fit: Calibration, problem: DiagnosisProblem, name: str) -> tuple[float, float]:
    """Return the change of a number's logarithm that reduces the squared residual most, to first order, beside changes
    of the fitted parameters, and the rms residual that it leaves, SI; (0, inf) if the number does nothing.
    """
    slope = _slope(fit, problem, name)
    motion = motion_of(problem.fitted, np.concatenate([part.measured for part in problem.fitted]))
    if slope is None or STEP * np.std(slope) < ACCURACY * motion:
        return 0.0, np.inf
    slopes = np.column_stack([fit.movable, slope])
    change, *_ = np.linalg.lstsq(slopes, -fit.residuals, rcond=None)
    return float(change[-1]), float(np.sqrt(np.mean((fit.residuals + slopes @ change) ** 2)))


def _slope(fit: Calibration, problem: DiagnosisProblem, name: str) -> np.ndarray | None:
    """Return the derivative of the residuals with respect to a number's logarithm, (m,), SI; None if it cannot change."""
    for step in (STEP, -STEP):  # the number may be at a limit of the rig
        with suppress(DeatwinError):
            moved = free_run_residuals(_other(fit.plant, name, step), problem.fitted)
            if moved is not None:
                return (moved - fit.residuals) / step
    return None
