"""Test whether recordings show the cycle that an explanation assumes."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.refit.fitted import fitted_effect

QUARTER = 0.25
"""Smallest share of a cycle that must be recorded. Between its steepest point and its peak a sine departs from the
chord by a fifth of its rise, as any drift may."""


def shows_its_cycles(candidate: Candidate, parts: Sequence[Part]) -> bool:
    """Return whether an experiment lasts for a quarter of each cycle of a candidate's effects."""
    # With a free period and phase, a smaller part of a cycle can imitate any slow curve. A cycle that was measured in
    # each of the recordings counts as shown.
    measured = set[str].intersection(*(_measured(part) for part in parts))
    lasts = max(float(part.timepts[-1] - part.timepts[0]) for part in parts)
    plant = candidate.calibration.plant
    effects = [fitted_effect(plant, name) for name in plant.effect_names if name in candidate.effects]
    return all(lasts >= QUARTER * effect.cycle(measured) for effect in effects)


def _measured(part: Part) -> set[str]:
    """Return the names of the further channels of an experiment."""
    return {name for record in part.experiment.recordings for name in record.extras}
