"""Fits that spend their simulations where they matter: a rough one for every form, a fine one for the good ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, calibrate
from deatwin.plant.model import Plant

__all__ = ["approach", "search", "settle"]

OPENING_SAMPLES = 4000
"""The first approach uses the opening of each experiment, long enough for the film's fast parameters."""
OPENING_EVALUATIONS = 8
ROUGH = 3e-3
"""A form that leaves a large residual need not be fitted better than to 0.15 % of it,"""
ROUGH_EVALUATIONS = 10
"""nor with more simulations than these."""
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


def _opening(part: Part) -> Part:
    """The counted samples among the first few thousand of an experiment."""
    left, masks = OPENING_SAMPLES, []
    for mask in part.masks:
        masks.append(mask & (np.arange(mask.size) < left))
        left -= mask.size
    if not any(mask.any() for mask in masks):
        return part
    return Part(experiment=part.experiment, masks=tuple(masks))
