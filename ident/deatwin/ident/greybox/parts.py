"""Selected samples of experiments, and the simulated readings of a plant there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.timeline import Timeline


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Selection of the samples of an experiment to fit.

    Parameters
    ----------
    experiment : Experiment
        Recordings on one clock.
    masks : tuple of ndarray of bool
        Mask of the selected samples for each recording.
    """

    experiment: Experiment
    masks: tuple[np.ndarray, ...]

    def __post_init__(self) -> None:
        sizes = [r.n_samples for r in self.experiment.recordings]
        if [m.size for m in self.masks] != sizes:
            raise DataError(f"masks have {[m.size for m in self.masks]} samples, the recordings {sizes}")

    @classmethod
    def whole(cls, experiment: Experiment) -> Part:
        """Select all samples of an experiment.

        Parameters
        ----------
        experiment : Experiment
            Recordings on one clock.
        """
        masks = tuple(np.ones(r.n_samples, dtype=bool) for r in experiment.recordings)
        return cls(experiment=experiment, masks=masks)

    def until_last(self) -> Part:
        """Return the same samples, with the experiment cut after the last of them."""
        last = max(k for k, mask in enumerate(self.masks) if mask.any())
        end = int(np.flatnonzero(self.masks[last])[-1]) + 1
        records = self.experiment.recordings
        kept = (*records[:last], records[last].section(0, end))
        return Part(experiment=Experiment(recordings=kept), masks=(*self.masks[:last], self.masks[last][:end]))

    def opening(self, count: int) -> Part:
        """Select the first of the selected samples, with the experiment cut after the last of them.

        Parameters
        ----------
        count : int
            Number of samples, at least 1; if there are fewer, all are taken.
        """
        before = np.cumsum([0, *(int(mask.sum()) for mask in self.masks)])
        masks = tuple(
            mask & (first + np.cumsum(mask) <= count) for mask, first in zip(self.masks, before[:-1], strict=True)
        )
        return Part(experiment=self.experiment, masks=masks).until_last()

    @property
    def size(self) -> int:
        """Number of selected samples."""
        return sum(int(mask.sum()) for mask in self.masks)

    @property
    def timepts(self) -> np.ndarray:
        """Clock times of the selected samples, concatenated over recordings, shape (n,), s."""
        return np.concatenate([r.timepts[m] for r, m in zip(self.experiment.recordings, self.masks, strict=True)])

    def counted(self, timeline: Timeline) -> np.ndarray:
        """Return the simulated samples at whose ends the selected readings were taken.

        Parameters
        ----------
        timeline : Timeline
            Timeline of the experiment.

        Returns
        -------
        ndarray of int, shape (n,)
            Indices of samples of the simulation.
        """
        return np.concatenate([r[m] for r, m in zip(timeline.readings, self.masks, strict=True)])

    @property
    def commands(self) -> np.ndarray:
        """Commands at the selected samples, concatenated over recordings, shape (n,), in their unit."""
        records = zip(self.experiment.recordings, self.masks, strict=True)
        return np.concatenate([r.inputs[0, m] for r, m in records])

    @property
    def measured(self) -> np.ndarray:
        """Readings at the selected samples, concatenated over recordings, shape (n,), SI."""
        records = zip(self.experiment.recordings, self.masks, strict=True)
        return np.concatenate([r.outputs[0, m] for r, m in records])


Records = Part | Experiment | Recording | Sequence[Part | Experiment | Recording]
"""Data on which a plant can be calibrated."""


def parts_of(records: Records) -> tuple[Part, ...]:
    """Whatever counts, as parts."""
    listed = (records,) if isinstance(records, Part | Experiment | Recording) else tuple(records)
    if not listed:
        raise DataError("no recording is given: a calibration needs at least one")
    return tuple(_part(one) for one in listed)


def _part(given: object) -> Part:
    if isinstance(given, Part):
        return given
    if isinstance(given, Recording):
        return Part.whole(Experiment(recordings=(given,)))
    if isinstance(given, Experiment):
        return Part.whole(given)
    raise DataError(
        f"a {type(given).__name__} is no recording: give a Recording, an Experiment, a Part of one, or a list of such"
    )


def reading_times(plant: Plant, parts: Sequence[Part]) -> np.ndarray:
    """Clock times at which a plant has the readings that count. `parts` which samples; returns (n,)."""
    timelines = [plant.timeline(part.experiment) for part in parts]
    return np.concatenate(
        [t.start + (part.counted(t) + 1) * t.sample_time for t, part in zip(timelines, parts, strict=True)]
    )


def simulated(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Free-run readings of a plant at the samples that count. `parts` which samples; returns (n,)."""
    pieces = []
    for part in parts:
        timeline = plant.timeline(part.experiment)
        run = plant.simulator.run(  # `plant.simulate` also looks for events, as long again
            timeline.commands,
            start=timeline.start,
            sample_time=timeline.sample_time,
            rest_command=plant.rig.start.rest_command,
            values=plant.free_values,
            channels=timeline.channels,
        )
        if not run.status.ok:
            return None
        pieces.append(run.outputs[part.counted(timeline) + 1])
    return np.concatenate(pieces)


def free_run_residuals(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Measured minus simulated at the samples that count. `parts` which samples; returns (n,)."""
    readings = simulated(plant, parts)
    return None if readings is None else np.concatenate([part.measured for part in parts]) - readings
