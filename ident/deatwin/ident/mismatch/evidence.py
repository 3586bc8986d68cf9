"""What a diagnosis saw, kept for figures and reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from deatwin.ident.mismatch.locate import Track
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["CandidateSummary", "Drawn", "Evidence", "Step", "readings", "tracks"]

FEWEST = 16
"""Samples of a record that can be located in time and frequency."""
Readings = tuple[tuple[np.ndarray, ...], ...]


class Drawn(Protocol):
    """A result that draws itself."""

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            A new figure without it.

        Returns
        -------
        matplotlib Axes
        """
        ...


class Step(Drawn, Protocol):
    """The result of one step of a diagnosis."""

    def to_dict(self) -> dict[str, Any]:
        """Its part of ``diagnosis.json``."""
        ...


@dataclass(frozen=True, kw_only=True)
class CandidateSummary:
    """An explanation that was tried.

    Parameters
    ----------
    effects : tuple of str
        Empty for the base plant.
    fitted, unseen : float
        Rms residuals on the fitted and on the unseen part, SI.
    d2 : float or None
        Squared distance d² from the chosen explanation on these recordings, where it was computed.
    """

    effects: tuple[str, ...]
    fitted: float
    unseen: float
    d2: float | None = None


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
    at_bound : tuple of str
        Its parameters that ended on a bound.
    noise_source : str
        Where the noise is known from.
    checked : Drawn or None
        State of the recordings.
    detection, location, discovery, advice, verification : Step or None
        Results of the steps that were taken.
    """

    experiments: tuple[Experiment, ...]
    base: Readings
    amended: Readings | None
    unseen: tuple[tuple[np.ndarray, ...], ...]
    candidates: tuple[CandidateSummary, ...]
    noise: float
    model_error: float
    base_model: CalibratedPlant
    at_bound: tuple[str, ...] = ()
    noise_source: str = ""
    checked: Drawn | None = None
    detection: Step | None = None
    location: Step | None = None
    discovery: Step | None = None
    advice: Step | None = None
    verification: Step | None = None


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
