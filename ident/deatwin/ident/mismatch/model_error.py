"""The plant's own error, as a part of the floor that a mismatch must exceed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Refinable
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig

BIASED = 1.5
"""Largest ratio by which a plant may raise the error that is expected of its rig. What is missing bends the base plant,
and a wrong effect any other, to where its equations hold no more: that is no reason to expect less of it. Of 150 base
plants from which nothing was missing (concealed physics, seed 78) none raised it by more than 4 %."""


def model_error_of(plant: Plant, problem: DiagnosisProblem) -> float:
    """Model error of a calibrated plant on the recordings on the problem.

    What is expected of the rig (none is quite as described) and what the plant cannot follow of finer equations of
    its own are independent of each other. Effects do not count: their equations are the same in both.

    Parameters
    ----------
    plant : Plant
        Calibrated.
    problem : DiagnosisProblem
        Recordings, and the error expected of a motion of their size.

    Returns
    -------
    float
        Rms, SI; the expected one where the rig has no finer equations, or they say nothing of any recording; at most
        half as much again, so none where none is expected.
    """
    bare = plant.without_effects()
    if not isinstance(bare.rig, Refinable):
        return problem.expected_error
    found = max((_not_followed(bare, part.experiment) for part in problem.everything), default=0.0)
    return min(float(np.hypot(problem.expected_error, found)), BIASED * problem.expected_error)


def _not_followed(plant: Plant, experiment: Experiment) -> float:
    """Rms of what a plant cannot follow of its finer equations, SI; 0 where these cannot be simulated soundly."""
    try:
        return plant.model_error(experiment).rms
    except SimulationError:
        return 0.0


def error_in(rig: Rig, reading: Reading, records: Sequence[Recording]) -> float | None:
    """Rms of a rig's own error in a further reading, SI; None where no recording has it."""
    rows = [record.reading(reading.name) for record in records]
    known = np.concatenate([row[np.isfinite(row)] for row in rows])
    return max(reading.model_error, rig.share_of_motion * float(known.std())) if known.size else None


def with_model_error(plant: Plant, error: float) -> Plant:
    """Return the same plant on a rig with another model error.

    Parameters
    ----------
    plant : Plant
        Any.
    error : float
        Rms, SI.

    Returns
    -------
    Plant
    """
    return plant.with_rig(replace(plant.rig, model_error=error))


def differences(rigs: Sequence[Rig]) -> tuple[dict[str, Any], ...]:
    """Return what rigs state differently, their model errors aside: those are found, not stated.

    Parameters
    ----------
    rigs : sequence of Rig
        Forms of one rig.

    Returns
    -------
    tuple of dict
        For each rig the fields in which they are not all equal, as `Rig.to_dict` has them.
    """
    stated = [replace(rig, model_error=rigs[0].model_error).to_dict() for rig in rigs]
    names = [name for name, value in stated[0].items() if any(other[name] != value for other in stated)]
    return tuple({name: each[name] for name in names} for each in stated)
