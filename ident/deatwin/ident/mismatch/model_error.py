"""Model error of a calibrated plant, and intervals of fitted parameters that allow for it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.covariance import with_errors
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import first_only
from deatwin.ident.mismatch.likelihood.several import own_errors
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Refinable
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig

BIASED = 1.5
"""Largest ratio of the model error to the expected one. Missing physics or a wrong effect biases a plant to values at
which its equations no longer hold; that must not excuse a mismatch. Of 150 clean base plants (concealed physics, seed
78) none exceeded the expected error by more than 4 %."""


def model_error_of(plant: Plant, problem: DiagnosisProblem) -> float:
    """Return the model error of a calibrated plant on the recordings of a diagnosis, rms, SI."""
    # Two independent errors add up: the expected one, because no rig is exactly as described, and the difference from
    # the plant's finer equations, if the rig has any. Effects have the same equations in both and are left out. The sum
    # is at most half as large again as the expected error, so 0 if none is expected.
    bare = plant.without_effects()
    if not isinstance(bare.rig, Refinable):
        return problem.expected_error
    found = max((_not_followed(bare, part.experiment) for part in first_only(problem.everything)), default=0.0)
    return min(float(np.hypot(problem.expected_error, found)), BIASED * problem.expected_error)


def _not_followed(plant: Plant, experiment: Experiment) -> float:
    """Return the rms difference of a plant from its finer equations after a refit, SI; 0 if these cannot be
    simulated.
    """
    try:
        return plant.model_error(experiment).rms
    except SimulationError:
        return 0.0


def error_in(rig: Rig, reading: Reading, records: Sequence[Recording]) -> float | None:
    """Return the rms model error of a rig in a further reading, SI; None if no recording contains it."""
    rows = [record.reading(reading.name) for record in records]
    known = np.concatenate([row[np.isfinite(row)] for row in rows])
    return max(reading.model_error, rig.share_of_motion * float(known.std())) if known.size else None


def with_model_error(plant: Plant, error: float) -> Plant:
    """Return the same plant on a rig with another model error, rms, SI."""
    return plant.with_rig(replace(plant.rig, model_error=error))


def differences(rigs: Sequence[Rig]) -> tuple[dict[str, Any], ...]:
    """Return the fields in which variants of a rig differ, for each variant; found model errors are left out."""
    stated = [replace(rig, model_error=rigs[0].model_error).to_dict() for rig in rigs]
    names = [name for name, value in stated[0].items() if any(other[name] != value for other in stated)]
    return tuple({name: each[name] for name in names} for each in stated)


def with_own_errors(fit: Calibration, problem: DiagnosisProblem, noise: float) -> Calibration:
    """Return a fit with a covariance that also includes the plant's model error; `noise` in SI."""
    # Repeatable model errors bias a fit in the same way in every recording, so residuals do not show them. Their sizes
    # are those that the likelihood expects.
    whole = problem.everything
    parts = whole if fit.residuals.size == sum(part.size for part in whole) else problem.fitted
    rig, readings = problem.nominal.rig, readings_of_fit(parts, fit.residuals)
    own = own_errors(rig, parts, readings, noise, problem.expected_error)
    columns = own.columns_after(fit.residuals, fit.jacobian)
    return replace(fit, covariance=with_errors(fit.covariance, fit.jacobian, columns))


def perhaps_absent(fit: Calibration, effects: Collection[str]) -> tuple[str, ...]:
    """Return those of some effects whose strength may be zero, by its 95 % interval at the values of their other
    parameters.
    """
    # An effect without strength has no time constant, say, so the question is asked at the fitted one: a drift may become
    # large and slow together, but not small. A film's relaxing modulus is known only as a share of its other modulus,
    # because the permittivity scales both. No interval tells of such a strength whether it is zero; the ablation does.
    added = [effect for effect in fit.plant.effects if effect.name in effects]
    strengths = {effect.name: f"{effect.name}.{effect.strength}" for effect in added}
    fitted = set(fit.names) - fit.undetermined  # a user's effect may have a known strength
    known = {name: _at_its_shape(fit, name, strength) for name, strength in strengths.items() if strength in fitted}
    return tuple(name for name, (low, high) in known.items() if low <= 0.0 <= high)


def _at_its_shape(fit: Calibration, effect: str, strength: str) -> tuple[float, float]:
    """Return the 95 % interval of a strength, given the effect's other parameters."""
    k = fit.names.index(strength)
    known = set(fit.names) - fit.undetermined - {strength}
    others = [i for i, name in enumerate(fit.names) if name in known and name.startswith(f"{effect}.")]
    spread = fit.covariance.copy()
    spread[k, k] -= spread[k, others] @ np.linalg.pinv(spread[np.ix_(others, others)]) @ spread[others, k]
    return replace(fit, covariance=spread).interval(strength)
