"""Find readings after a gap that depend on an unknown change of the command within the gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.quality.quality import DataQuality
from deatwin.ident.mismatch.thresholds import PRACTICAL_SHARE
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording


def without_unknown(checked: DataQuality, plant: Plant, noise: float) -> DataQuality:
    """Mark readings that depend on how a command changed in a gap; `noise` is in SI.

    Return the same object if there are none, or hardly any others.
    """
    # The command is assumed to have changed at the end of the gap. It may instead have changed at its beginning, or
    # varied as on either side of it. A reading is unknown if a calibrated plant then differs by more than noise and
    # model error, so an oscillating plant is left out for as long as it oscillates.
    floor, marked = float(np.hypot(noise, plant.rig.model_error)), []
    for experiment in checked.experiments:
        masks = [np.zeros(record.n_samples, dtype=bool) for record in experiment.recordings]
        histories = [_filled(experiment, fill) for fill in (_early, _as_before, _as_behind)]
        if len(histories[0].recordings) > len(masks):
            starts = {record.start for record in experiment.recordings}
            assumed = plant.simulate(experiment).require().outputs
            for history in histories:
                found = zip(history.recordings, plant.simulate(history).require().outputs, strict=True)
                known = [rows for record, rows in found if record.start in starts]
                for mask, one, other in zip(masks, assumed, known, strict=True):
                    mask[: np.flatnonzero(np.abs(other[0] - one[0]) > floor).max(initial=-1) + 1] = True
        marked.append(tuple(masks))
    every = np.concatenate([mask for masks in marked for mask in masks])
    return replace(checked, unknown=tuple(marked)) if every.any() and np.mean(~every) >= PRACTICAL_SHARE else checked


def _filled(experiment: Experiment, fill: Callable[[np.ndarray, np.ndarray, int], np.ndarray]) -> Experiment:
    """Return an experiment with given commands in each gap in which the command changed."""
    first, *others = experiment.recordings
    records: list[Recording] = [first]
    for record in others:
        before = records[-1]
        gap = round((record.start - before.end) / before.sample_time)
        if gap > 0 and record.inputs[0, 0] != before.inputs[0, -1]:
            inputs = np.repeat(record.inputs[:, :1], gap, axis=1)
            inputs[0] = fill(before.inputs[0], record.inputs[0], gap)
            outputs = np.repeat(record.outputs[:, :1], gap, axis=1)
            records.append(replace(record, start=before.end, inputs=inputs, outputs=outputs, extras={}))
        records.append(record)
    return Experiment(recordings=tuple(records))


def _early(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the command after a gap, applied from the beginning of the gap."""
    return np.full(gap, behind[0])


def _as_before(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the commands before a gap in reversed order, so that there is no step at its beginning."""
    return np.pad(before[::-1][:gap], (0, max(gap - before.size, 0)), mode="reflect")[:gap]


def _as_behind(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the commands after a gap in reversed order, up to its end."""
    return _as_before(behind[::-1], before, gap)[::-1]
