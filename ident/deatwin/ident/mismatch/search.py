"""Fits that spend their simulations where they matter: a rough one for every form, a fine one for the good ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, calibrate, simulated
from deatwin.plant.model import Plant

__all__ = ["approach", "at_its_time", "search", "settle"]

OPENING_SAMPLES = 4000
"""The first approach uses the opening of each experiment, long enough for the film's fast parameters."""
OPENING_EVALUATIONS = 8
ROUGH = 3e-3
"""A form that leaves a large residual need not be fitted better than to 0.15 % of it,"""
ROUGH_EVALUATIONS = 10
"""nor with more simulations than these."""
EVENT_STEP = 0.02
"""Share of the record by which an event is moved first."""
WORTH_POLISHING = 4.0
"""Mean squared residual against noise and model error, below which a form is fitted to the end."""


def approach(start: Plant, parts: Sequence[Part]) -> Calibration:
    """Fit the opening of each experiment only: cheap, and near enough to go on from.

    Parameters
    ----------
    start : Plant
        With starting values.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    Calibration
        On the openings of `parts`.
    """
    openings = [_opening(part) for part in parts]
    return calibrate(start, openings, evaluations=OPENING_EVALUATIONS, tolerance=ROUGH)


def settle(near: Plant, parts: Sequence[Part], noise: float) -> Calibration:
    """Fit all counted samples: roughly, and to the end where it is worth it.

    Parameters
    ----------
    near : Plant
        With values from `approach`.
    parts : sequence of Part
        Samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Calibration
        On all of `parts`.
    """
    rough = calibrate(near, parts, evaluations=ROUGH_EVALUATIONS, tolerance=ROUGH)
    floor = noise**2 + near.rig.model_error**2
    if not rough.status.ok or rough.rms**2 > WORTH_POLISHING * floor:
        return rough
    return calibrate(rough.plant, parts)


def search(start: Plant, parts: Sequence[Part], noise: float) -> Calibration:
    """Fit a plant from far away.

    Parameters
    ----------
    start : Plant
        With starting values.
    parts : sequence of Part
        Samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Calibration
        On all of `parts`.
    """
    near = approach(start, parts)
    found = settle(near.plant, parts, noise)
    return found if found.status.ok or not near.status.ok else settle(start, parts, noise)


def at_its_time(fit: Calibration, parts: Sequence[Part], noise: float) -> Calibration:
    """Move the events in a fitted plant to where they explain most, and fit it anew.

    Only a sample or two know of the time of an event, so no fit can move it; it is searched for.

    Parameters
    ----------
    fit : Calibration
        Of a plant on `parts`.
    parts : sequence of Part
        Samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Calibration
        The same one where the plant has no event or none that moves.
    """
    plant = fit.plant
    for effect in plant.effects:
        if effect.event:
            plant = _moved(plant, f"{effect.name}.{effect.event}", parts)
    return fit if plant is fit.plant else settle(plant, parts, noise)


def _moved(plant: Plant, name: str, parts: Sequence[Part]) -> Plant:
    """The plant with one event where the squared residual is least, found by steps that are halved."""
    times = np.concatenate([part.timepts for part in parts])
    step, best, least = EVENT_STEP * float(np.ptp(times)), plant, _squares(plant, parts)
    while step > plant.rig.sample_time / 2:
        at = best.parameters[name].value
        tried = [best.with_values({name: at + s}) for s in (-step, step) if times.min() < at + s < times.max()]
        losses = [_squares(other, parts) for other in tried]
        if losses and min(losses) < least:
            least, best = min(losses), tried[int(np.argmin(losses))]
        else:
            step /= 2
    return best


def _squares(plant: Plant, parts: Sequence[Part]) -> float:
    readings = simulated(plant, [part.until_last() for part in parts])
    if readings is None:
        return float(np.inf)
    return float(np.sum((np.concatenate([part.measured for part in parts]) - readings) ** 2))


def _opening(part: Part) -> Part:
    """The counted samples among the first few thousand of an experiment."""
    left, masks = OPENING_SAMPLES, []
    for mask in part.masks:
        masks.append(mask & (np.arange(mask.size) < left))
        left -= mask.size
    if not any(mask.any() for mask in masks):
        return part
    return Part(experiment=part.experiment, masks=tuple(masks))
