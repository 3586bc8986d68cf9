"""Faults that a comparison with a calibrated plant reveals: held readings and bursts of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.quality.bursts import noisier
from deatwin.ident.mismatch.quality.quality import DataQuality, Masks, by_experiment, marked_in_any
from deatwin.ident.mismatch.quality.suspects import held
from deatwin.ident.soundness import resolution
from deatwin.plant.model import Plant


def without_faults(checked: DataQuality, plant: Plant) -> DataQuality:
    """Mark faults of readings that a comparison with a calibrated plant reveals; return the same object if none."""
    outputs = [plant.simulate(experiment).require().outputs for experiment in checked.experiments]
    commands = [record.inputs[0] for experiment in checked.experiments for record in experiment.recordings]
    stuck: dict[str, Masks] = {}
    bursts: dict[str, Masks] = {}
    for row, reading in enumerate(plant.rig.readings):
        name, simulated, measured = reading.name if row else "", [], []
        for experiment, rows, sound in zip(checked.experiments, outputs, checked.sound, strict=True):
            simulated += [each[row] for each in rows]
            for record, mask in zip(experiment.recordings, sound, strict=True):
                measured.append(record.reading(name) if name else np.where(mask, record.outputs[0], np.nan))
        still = [
            held(*three, plant.rig.sample_time, reading.noise)
            for three in zip(measured, simulated, commands, strict=True)
        ]
        alive = [np.where(mask, np.nan, values) for mask, values in zip(still, measured, strict=True)]
        steps = [resolution(known) for known in (values[np.isfinite(values)] for values in alive) if known.size]
        residuals = [values - y for values, y in zip(alive, simulated, strict=True)]
        noisy = noisier(residuals, commands, max([reading.noise, *(step / np.sqrt(12.0) for step in steps)]))
        for found, masks in ((stuck, still), (bursts, noisy)):
            if any(mask.any() for mask in masks):
                found[name] = by_experiment(checked, masks)
    if not stuck and not bursts:
        return checked
    own = stuck.pop("", None)
    return replace(
        checked, bursts=bursts, stuck_further=stuck, stuck=marked_in_any(checked.stuck, own) if own else checked.stuck
    )
