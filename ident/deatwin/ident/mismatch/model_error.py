"""Model error of a calibrated plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.parts import first_only
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
