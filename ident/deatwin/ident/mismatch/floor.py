"""The plant's own error as a part of the floor that a mismatch must exceed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.base import Base
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.name import Candidate
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Refinable

__all__ = ["with_model_error"]


def with_model_error(bench: Bench, base: Base) -> tuple[Bench, Base]:
    """Bench and base with the model error that the calibrated plant has on these recordings.

    What the rig states (another rig is never quite as described) and what the plant cannot follow of finer
    equations of its own are independent of each other.

    Parameters
    ----------
    bench : Bench
        Its nominal plant has the error expected of a motion of this size.
    base : Base
        Calibrated.

    Returns
    -------
    tuple of Bench and Base
        Unchanged where the rig has no finer equations, or they cannot be simulated on these recordings.
    """
    found = _own_error(base.chosen.calibration.plant, bench)
    if found is None:
        return bench, base
    error = float(np.hypot(bench.stated_error, found))
    chosen, *rivals = (_judged_with(candidate, error) for candidate in (base.chosen, *base.rivals))
    return (
        replace(bench, nominal=_with_error(bench.nominal, error)),
        replace(base, chosen=chosen, rivals=tuple(rivals)),
    )


def _own_error(plant: Plant, bench: Bench) -> float | None:
    if not isinstance(plant.rig, Refinable):
        return None
    try:
        return max(plant.model_error(part.experiment).rms for part in bench.everything)
    except SimulationError:
        return None


def _judged_with(candidate: Candidate, error: float) -> Candidate:
    calibration = replace(candidate.calibration, plant=_with_error(candidate.calibration.plant, error))
    return replace(candidate, calibration=calibration)


def _with_error(plant: Plant, error: float) -> Plant:
    return plant.with_rig(replace(plant.rig, model_error=error))
