"""What a diagnosis saw, kept for figures and reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch.locate import Track
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

__all__ = ["CandidateSummary", "Evidence", "readings", "tracks"]

FEWEST = 16
"""Samples of a record that can be located in time and frequency."""
Readings = tuple[tuple[np.ndarray, ...], ...]


@dataclass(frozen=True, kw_only=True)
class CandidateSummary:
    """An explanation that was tried.

    Parameters
    ----------
    effects : tuple of str
        Empty for the base plant.
    fitted, unseen : float
        Rms residuals on the fitted and on the unseen part, SI.
    """

    effects: tuple[str, ...]
    fitted: float
    unseen: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Recordings beside simulations; all in SI.

    Parameters
    ----------
    experiments : tuple of Experiment
        The recordings.
    base : tuple of tuple of ndarray, each of shape (n,)
        The calibrated base plant's readings, for each experiment and record.
    amended : same shape, or None
        The amended plant's, where there are causes.
    unseen : tuple of tuple of ndarray of bool
        Samples that no fit saw before the verdict.
    candidates : tuple of CandidateSummary
        All explanations that were tried, the base plant first.
    noise, model_error : float
        Rms.
    base_model : CalibratedPlant
        The calibrated base plant.
    """

    experiments: tuple[Experiment, ...]
    base: Readings
    amended: Readings | None
    unseen: tuple[tuple[np.ndarray, ...], ...]
    candidates: tuple[CandidateSummary, ...]
    noise: float
    model_error: float
    base_model: CalibratedPlant


def readings(plant: Plant, experiments: Sequence[Experiment]) -> Readings:
    """A plant's free-run readings.

    Parameters
    ----------
    plant : Plant
        Simulated from rest through each experiment.
    experiments : sequence of Experiment
        Only the commands are used.

    Returns
    -------
    tuple of tuple of ndarray, each of shape (n,)
        SI.
    """
    return tuple(tuple(y[0] for y in plant.simulate(e).outputs) for e in experiments)


def tracks(plant: Plant, experiments: Sequence[Experiment]) -> tuple[Track, ...]:
    """Residual and operating signals of each record.

    Parameters
    ----------
    plant : Plant
        Calibrated.
    experiments : sequence of Experiment
        Recordings.

    Returns
    -------
    tuple of Track
        Signals: the command, the simulated reading in µm (or its own unit) and its rate.
    """
    rig = plant.rig
    size = 1e-6 if rig.output_unit == "m" else 1.0
    found = []
    for experiment, simulated in zip(experiments, readings(plant, experiments), strict=True):
        for record, reading in zip(experiment.recordings, simulated, strict=True):
            if record.n_samples < FEWEST:
                continue  # a splinter between two gaps has no place of its own
            signals = {
                rig.input_name: record.inputs[0],
                rig.output_name: reading / size,
                f"{rig.output_name}_rate": np.gradient(reading / size, record.sample_time),
            }
            found.append(
                Track(
                    timepts=record.timepts, residual=record.outputs[0] - reading, signals=signals,
                    sample_time=record.sample_time,
                )
            )
    return tuple(found)
