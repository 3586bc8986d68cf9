"""The residual of one record, with the signals on which it may depend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.parts import row_of, settled
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

FEWEST = 16
"""Smallest number of samples of a record in which a mismatch is located."""

Unit = tuple[str, float]
"""Name of a unit, and its SI size."""
SI: Unit = ("SI", 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The residual of one record and the signals that may go with it."""

    timepts: np.ndarray  # (n,), on the running clock, s
    residual: np.ndarray  # (n,), measured minus simulated, SI
    signals: Mapping[str, np.ndarray]  # operating signals, (n,) each, in the units in which they are reported
    sample_time: float


@checks_its_arguments
def readings(plant: Plant, experiments: Sequence[Experiment], reading: str = "") -> tuple[tuple[np.ndarray, ...], ...]:
    """Simulate a plant through experiments, and return one of its readings.

    Parameters
    ----------
    plant : Plant
        Plant, simulated from rest through each experiment.
    experiments : sequence of Experiment
        Experiments, of which only the commands are used.
    reading : str
        Name of the reading; empty for the first reading of the rig.

    Returns
    -------
    tuple of tuple of ndarray, each of shape (n,)
        Simulated reading for each experiment and each of its recordings, SI.

    Raises
    ------
    SimulationError
        If the plant cannot be simulated to the end.
    """
    row = row_of(plant.rig, reading)
    return tuple(tuple(y[row] for y in plant.simulate(e).require().outputs) for e in experiments)


def tracks(
    plant: Plant,
    experiments: Sequence[Experiment],
    reading: str = "",
    usable: Sequence[Sequence[np.ndarray]] | None = None,
) -> tuple[Track, ...]:
    """Return residual and operating signals of each record; an empty `reading` stands for the first one.

    The residual is 0 at samples that are not `usable`, (n,) each; by default all are.
    """
    rig = plant.rig
    size = amplitude_unit(rig.output_unit)[1]
    row = row_of(plant.rig, reading)
    found = []
    for number, experiment in enumerate(experiments):
        simulated = plant.simulate(experiment).require().outputs
        sound = settled(experiment, rig) if usable is None else usable[number]
        for record, rows, counts in zip(experiment.recordings, simulated, sound, strict=True):
            if record.n_samples < FEWEST:
                continue  # too short, between two gaps, for a location of its own
            motion = rows[0] / size
            signals = {
                rig.input_name: record.inputs[0],
                rig.output_name: motion,
                f"{rig.output_name}_rate": np.gradient(motion, record.sample_time),
            }
            found.append(
                Track(
                    timepts=record.timepts,
                    # Missing and faulty values contain no information, nor do values that still depend on an unknown start.
                    residual=np.where(counts, np.nan_to_num(record.reading(reading) - rows[row]), 0.0),
                    signals=signals,
                    sample_time=record.sample_time,
                )
            )
    return tuple(found)
