"""The plant's own error, as a part of the floor that a mismatch must exceed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.bench import Bench
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Refinable

__all__ = ["floor_of", "with_model_error"]


def floor_of(plant: Plant, bench: Bench) -> float:
    """Model error of a calibrated plant on the recordings on the bench.

    What is expected of the rig (none is quite as described) and what the plant cannot follow of finer equations of
    its own are independent of each other. Effects do not count: their equations are the same in both.

    Parameters
    ----------
    plant : Plant
        Calibrated.
    bench : Bench
        Recordings, and the error expected of a motion of their size.

    Returns
    -------
    float
        Rms, SI; the expected one where the rig has no finer equations, or they cannot be simulated here.
    """
    bare = plant.without_effects()
    if not isinstance(bare.rig, Refinable):
        return bench.expected_error
    try:
        found = max(bare.model_error(part.experiment).rms for part in bench.everything)
    except SimulationError:
        return bench.expected_error
    return float(np.hypot(bench.expected_error, found))


def with_model_error(plant: Plant, error: float) -> Plant:
    """The same plant on a rig with another model error.

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
