"""One number of the rig file that is wrong: the only change that the recordings need, if they need no effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch.likelihood.beforehand import DATA_SHEET
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.search import EVALUATIONS
from deatwin.ident.mismatch.thresholds import ACCURACY, FEW, NEGLIGIBLE
from deatwin.plant.errors import DeatwinError
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
    own = {field.name: getattr(rig, field.name) for field in fields(rig) if field.name not in shared}
    return {name: value for name, value in own.items() if isinstance(value, float) and value}


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
    """Fit the plant together with one stated number, by Gauss-Newton steps of its logarithm."""
    whole = 0.0
    for _ in range(ROUNDS):
        step = float(np.clip(step, -NEAR, NEAR))
        whole += step
        fit = _with_number(fit, problem, name, float(np.exp(step)))
        if abs(whole) > FARTHEST or not fit.status.ok:
            return None
        if abs(step) < SETTLED:
            break
        step, _ = _step(fit, problem, name)
    return fit


def _with_number(fit: Calibration, problem: DiagnosisProblem, name: str, factor: float) -> Calibration:
    """Calibrate the plant with one stated number multiplied by a factor."""
    rig = fit.plant.rig
    changed = fit.plant.with_rig(replace(rig, **{name: factor * getattr(rig, name)}))
    return descend(changed, problem.fitted, evaluations=EVALUATIONS, tolerance=NEGLIGIBLE)


def _step(fit: Calibration, problem: DiagnosisProblem, name: str) -> tuple[float, float]:
    """Return the change of a number's logarithm that reduces the squared residual most, to first order, beside changes
    of the fitted parameters, and the rms residual that it leaves, SI; (0, inf) if the number does nothing.
    """
    rig = fit.plant.rig
    try:
        changed = fit.plant.with_rig(replace(rig, **{name: float(np.exp(STEP)) * getattr(rig, name)}))
        moved = free_run_residuals(changed, problem.fitted)
    except DeatwinError:  # the number is at a limit of the rig
        moved = None
    motion = np.std(np.concatenate([part.measured for part in problem.fitted]))
    if moved is None or np.std(moved - fit.residuals) < ACCURACY * motion:
        return 0.0, np.inf
    slopes = np.column_stack([fit.movable, (moved - fit.residuals) / STEP])
    change, *_ = np.linalg.lstsq(slopes, -fit.residuals, rcond=None)
    return float(change[-1]), float(np.sqrt(np.mean((fit.residuals + slopes @ change) ** 2)))
