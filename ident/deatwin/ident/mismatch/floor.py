"""The plant's own error, as a part of the floor that a mismatch must exceed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.bench import Bench
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Refinable
from deatwin.plant.recording import Experiment

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
        Rms, SI; the expected one where the rig has no finer equations, or they say nothing of any recording.
    """
    bare = plant.without_effects()
    if not isinstance(bare.rig, Refinable):
        return bench.expected_error
    found = max((_not_followed(bare, part.experiment) for part in bench.everything), default=0.0)
    return float(np.hypot(bench.expected_error, found))


def _not_followed(plant: Plant, experiment: Experiment) -> float:
    """Rms of what a plant cannot follow of its finer equations, SI; 0 where these cannot be simulated soundly."""
    try:
        return plant.model_error(experiment).rms
    except SimulationError:
        return 0.0


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
