"""Select samples of experiments, and simulate a plant's readings there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deatwin.plant.arguments import each, instance
from deatwin.plant.checks import check_units, experiment_for
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording, label
from deatwin.plant.rigs.base import Rig
from deatwin.plant.timeline import Timeline


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Selection of the samples of an experiment to which a plant is fitted.

    Parameters
    ----------
    experiment : Experiment
        Recordings on one clock.
    masks : tuple of ndarray of bool
        One array for each recording, with one entry for each sample; True selects the sample.
    reading : str
        Name of the reading to fit; empty for the first reading of the rig.
    weight : float
        Factor by which the reading and its residuals are multiplied: the noise of the rig's first reading divided by
        the noise of this reading.
    levels : tuple of ndarray of float, optional
        For each recording, the standard deviation of the noise at each sample, relative to its usual value. Residuals
        are divided by this ratio. By default 1 at all samples.
    """

    experiment: Experiment
    masks: tuple[np.ndarray, ...]
    reading: str = ""
    weight: float = 1.0
    levels: tuple[np.ndarray, ...] | None = None

    def __post_init__(self) -> None:
        instance(Experiment)(self.experiment, "experiment")
        each(instance(np.ndarray))(self.masks, "masks")
        sizes = [r.n_samples for r in self.experiment.recordings]
        if [m.size for m in self.masks] != sizes:
            raise DataError(f"masks have {[m.size for m in self.masks]} samples, the recordings {sizes}")

    @classmethod
    def whole(cls, experiment: Experiment) -> Part:
        """Select all samples of an `experiment`."""
        masks = tuple(np.ones(r.n_samples, dtype=bool) for r in experiment.recordings)
        return cls(experiment=experiment, masks=masks)

    def until_last(self) -> Part:
        """Return a part with the same samples, whose experiment ends at the last of them."""
        last = max(k for k, mask in enumerate(self.masks) if mask.any())
        end = int(np.flatnonzero(self.masks[last])[-1]) + 1
        records = self.experiment.recordings
        kept = (*records[:last], records[last].section(0, end))
        masks = (*self.masks[:last], self.masks[last][:end])
        levels = None if self.levels is None else (*self.levels[:last], self.levels[last][:end])
        return replace(self, experiment=Experiment(recordings=kept), masks=masks, levels=levels)

    def opening(self, count: int) -> Part:
        """Return a part with the first `count` of the selected samples, whose experiment ends at the last of them."""
        before = np.cumsum([0, *(int(mask.sum()) for mask in self.masks)])
        masks = tuple(
            mask & (first + np.cumsum(mask) <= count) for mask, first in zip(self.masks, before[:-1], strict=True)
        )
        return replace(self, masks=masks).until_last()

    @property
    def size(self) -> int:
        """Number of selected samples."""
        return sum(int(mask.sum()) for mask in self.masks)

    @property
    def timepts(self) -> np.ndarray:
        """Clock times of the selected samples, concatenated over recordings, shape (n,), s."""
        return self._selected(r.timepts for r in self.experiment.recordings)

    def counted(self, timeline: Timeline) -> np.ndarray:
        """Return the indices of the samples of `timeline` that are selected, shape (n,)."""
        return self._selected(timeline.readings)

    @property
    def level(self) -> np.ndarray:
        """Entries of ``levels`` at the selected samples, concatenated over recordings, shape (n,)."""
        return np.ones(self.size) if self.levels is None else self._selected(self.levels)

    @property
    def commands(self) -> np.ndarray:
        """Commands at the selected samples, concatenated over recordings, shape (n,), in their unit."""
        return self._selected(r.inputs[0] for r in self.experiment.recordings)

    @property
    def measured(self) -> np.ndarray:
        """Readings at the selected samples times the weight, concatenated over recordings, shape (n,), SI."""
        return self.weight * self._selected(r.reading(self.reading) for r in self.experiment.recordings)

    def _selected(self, rows: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate([row[mask] for row, mask in zip(rows, self.masks, strict=True)])

    def row(self, rig: Rig) -> int:
        """Return the position of the reading in the list of readings of `rig`, counted from 0."""
        return row_of(rig, self.reading)

    @cached_property
    def history(self) -> tuple[object, ...]:
        """Everything on which a simulation of the experiment depends; parts with equal values share one simulation."""
        return tuple(
            (r.start, r.inputs.tobytes(), *((name, row.tobytes()) for name, row in r.extras.items()))
            for r in self.experiment.recordings
        )


LEAST_COUNTED = 0.9
"""Least share of an experiment whose readings count, however slowly the start is forgotten: a short recording cannot
spare more."""


def settled(experiment: Experiment, rig: Rig) -> tuple[np.ndarray, ...]:
    """Return, for each recording, which samples come after the ignored time of an unknown start."""
    lasts = experiment.recordings[-1].end - experiment.start
    since = experiment.start + min(rig.start.uncounted, (1 - LEAST_COUNTED) * lasts) - rig.sample_time / 2
    return tuple(r.timepts >= since for r in experiment.recordings)


def row_of(rig: Rig, reading: str) -> int:
    """Return the position of a reading among those of a rig, from 0; 0 if the name is empty."""
    return [one.name for one in rig.further].index(reading) + 1 if reading else 0


def whole_parts(experiments: Sequence[Experiment], rig: Rig) -> tuple[Part, ...]:
    """Return all samples that count: of the first reading, then of each further one, weighted by its noise."""
    found = [Part(experiment=experiment, masks=settled(experiment, rig)) for experiment in experiments]
    for reading in rig.further:
        if not rig.noise > 0.0:
            raise DataError(f"the rig states no noise of its {rig.output_name}: readings are weighted by their noise")
        for first in found[: len(experiments)]:
            experiment = first.experiment
            pairs = zip(experiment.recordings, first.masks, strict=True)
            masks = tuple(mask & np.isfinite(r.reading(reading.name)) for r, mask in pairs)
            if any(mask.any() for mask in masks):
                weight = rig.noise / reading.noise
                found.append(Part(experiment=experiment, masks=masks, reading=reading.name, weight=weight))
    return tuple(found)


Records = Part | Experiment | Recording | Sequence[Part | Experiment | Recording]
"""Data on which a plant can be calibrated."""


def first_only(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Return the parts of the first reading; they precede all others."""
    return tuple(part for part in parts if not part.reading)


def parts_of(records: Records, rig: Rig) -> tuple[Part, ...]:
    """Return all samples that count as parts, those of further readings last; DataError if a rig does not suit them."""
    listed = tuple(records) if isinstance(records, Iterable) else (records,)
    if not listed:
        raise DataError("no recording is given: a calibration needs at least one")
    whole = iter(whole_parts([experiment_for(rig, one) for one in listed if not isinstance(one, Part)], rig))
    given = [one if isinstance(one, Part) else next(whole) for one in listed]
    parts = (*given, *whole)
    for recording in (recording for part in parts for recording in part.experiment.recordings):
        check_units(recording, rig)
        if not len(recording.outputs):
            raise DataError(f"{label(recording)}: it has no output, so there is nothing to calibrate the plant to")
    return parts


def reading_times(plant: Plant, parts: Sequence[Part]) -> np.ndarray:
    """Return the clock times of a plant's readings; for means, the middles. `parts` selects samples; returns (n,)."""
    end = 0.5 if plant.rig.averages else 1.0
    timelines = [plant.timeline(part.experiment) for part in parts]
    return np.concatenate(
        [t.start + (part.counted(t) + end) * t.sample_time for t, part in zip(timelines, parts, strict=True)]
    )


def shared(plant: Plant, parts: Sequence[Part]) -> Iterator[tuple[Part, Timeline, int, np.ndarray]]:
    """Yield each part with its timeline, the number of samples that all readings need, and its own indices, (n,)."""
    timelines = [plant.timeline(part.experiment) for part in parts]
    each = [part.counted(timeline) for part, timeline in zip(parts, timelines, strict=True)]
    ends: dict[tuple[object, ...], int] = {}
    for part, counted in zip(parts, each, strict=True):
        ends[part.history] = max(ends.get(part.history, 1), int(counted.max(initial=0)) + 1)
    for part, timeline, counted in zip(parts, timelines, each, strict=True):
        yield part, timeline, ends[part.history], counted


def simulated(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Return a plant's free-run readings at the selected samples. `parts` selects samples; returns (n,)."""
    pieces, known = [], {}
    for part, timeline, end, counted in shared(plant, parts):
        if part.history not in known:
            # `plant.simulate` would also look for events, which takes as long again
            known[part.history] = plant.runner.run(**plant.given(timeline, end))
        run = known[part.history]
        if not run.status.ok:
            return None
        if part.reading:
            pieces.append(part.weight * run.further[counted + 1, part.row(plant.rig) - 1])
        else:
            pieces.append(run.outputs[counted + 1])
    return np.concatenate(pieces)


def level_of(parts: Sequence[Part]) -> np.ndarray:
    """Return the relative noise level at the selected samples, by which residuals are divided. Returns (n,)."""
    return np.concatenate([part.level for part in parts])


def motion_of(parts: Sequence[Part], readings: np.ndarray) -> float:
    """Return the rms of readings, (n,), each about its own mean: the zero of a further reading is no motion."""
    names = np.repeat([part.reading for part in parts], [part.size for part in parts])
    powers = sum(np.sum((own - own.mean()) ** 2) for own in (readings[names == name] for name in np.unique(names)))
    return float(np.sqrt(powers / readings.size))


def free_run_residuals(plant: Plant, parts: Sequence[Part]) -> np.ndarray | None:
    """Return (measured - simulated) / noise level at the selected samples. `parts` selects samples; returns (n,)."""
    readings = simulated(plant, parts)
    return (
        None if readings is None else (np.concatenate([part.measured for part in parts]) - readings) / level_of(parts)
    )
