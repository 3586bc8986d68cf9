"""Readings behind a gap in which the command changed: nobody knows when, and a while they depend on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.gate.gate import FEWEST_SOUND, Gate
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording


def without_unknown(checked: Gate, plant: Plant, noise: float) -> Gate:
    """The recordings with those readings marked that depend on when a command changed in a gap.

    It changed at its end, as is assumed, or at its beginning: where a calibrated plant reads otherwise then, by more than
    the sensor's `noise`, SI, and its own error. The same object where there are none, or hardly any others.
    """
    floor, marked = float(np.hypot(noise, plant.rig.model_error)), []
    for experiment in checked.experiments:
        masks = [np.zeros(record.n_samples, dtype=bool) for record in experiment.recordings]
        early = _changed_early(experiment)
        if len(early.recordings) > len(masks):
            starts = {record.start for record in experiment.recordings}
            late, soon = (plant.simulate(one).require().outputs for one in (experiment, early))
            known = [rows for record, rows in zip(early.recordings, soon, strict=True) if record.start in starts]
            for mask, one, other in zip(masks, late, known, strict=True):
                mask[: np.flatnonzero(np.abs(other[0] - one[0]) > floor).max(initial=-1) + 1] = True
        marked.append(tuple(masks))
    every = np.concatenate([mask for masks in marked for mask in masks])
    return replace(checked, unknown=tuple(marked)) if every.any() and np.mean(~every) >= FEWEST_SOUND else checked


def _changed_early(experiment: Experiment) -> Experiment:
    """Return an experiment in which the command after each gap applies from the beginning of the gap."""
    first, *others = experiment.recordings
    records: list[Recording] = [first]
    for record in others:
        before = records[-1]
        gap = round((record.start - before.end) / before.sample_time)
        if gap > 0 and record.inputs[0, 0] != before.inputs[0, -1]:
            inputs, outputs = (np.repeat(rows[:, :1], gap, axis=1) for rows in (record.inputs, record.outputs))
            records.append(replace(record, start=before.end, inputs=inputs, outputs=outputs, extras={}))
        records.append(record)
    return Experiment(recordings=tuple(records))
