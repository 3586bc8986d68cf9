"""The oracle: it is told which effect is concealed, and fits the same reduced plant with it to the same recordings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part
from deatwin.ident.mismatch.search import at_its_time, search
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.model import Plant

__all__ = ["consult"]

STARTS = 3
"""Shapes of an effect, as its residual suggests them, from which the oracle starts."""


def consult(
    nominal: Plant, base: Calibration, parts: Sequence[Part], truth: Sequence[str], noise: float
) -> Plant | None:
    """Fit the plant with the true effects.

    Parameters
    ----------
    nominal : Plant
        As the diagnosis was given it, on the rig that the base plant has.
    base : Calibration
        Of the plant without added effects, on the same samples.
    parts : sequence of Part
        All samples.
    truth : sequence of str
        Catalogue names of what is concealed.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Plant or None
        That of the best fit; None where none could be simulated, or the plant takes no such effect.
    """
    if not all(nominal.accepts(effect_named(name)) for name in truth):
        return None
    times = np.concatenate([part.timepts for part in parts])
    shapes = [_shapes(effect_named(name), times, base.residuals) for name in truth]
    fits = []
    for effects in product(*shapes):
        for plant in (nominal, base.plant):
            fit = search(plant.with_effects(*effects), parts, noise)
            if fit.status.ok:
                fits.append(at_its_time(fit, parts, noise))
        if fits and min(fit.rms for fit in fits) < 1.05 * noise:
            break  # nothing can be left
    return min(fits, key=lambda fit: fit.rms).plant if fits else None


def _shapes(effect: Effect, times: np.ndarray, residual: np.ndarray) -> Sequence[Effect]:
    return effect.starts(times, residual)[:STARTS] or (effect,)
