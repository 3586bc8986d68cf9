"""Test whether recordings show the cycle that an explanation assumes."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.refit.fitted import fitted_effect

QUARTER = 0.25
"""Of a cycle: from where it is steepest to its end a sine leaves the chord by a fifth of its rise, as any drift may."""


def shows_its_cycles(candidate: Candidate, parts: Sequence[Part]) -> bool:
    """Return whether some experiment lasts for a quarter of each cycle that the effects of a candidate follow.

    A smaller part of a cycle, with a period and a phase that are free, is any slow curve.

    Parameters
    ----------
    candidate : Candidate
        Fitted.
    parts : sequence of Part
        Recordings; a cycle whose course was measured in each of them is seen.

    Returns
    -------
    bool
    """
    measured = set[str].intersection(*(_measured(part) for part in parts))
    lasts = max(float(part.timepts[-1] - part.timepts[0]) for part in parts)
    plant = candidate.calibration.plant
    effects = [fitted_effect(plant, name) for name in plant.effect_names if name in candidate.effects]
    return all(lasts >= QUARTER * effect.cycle(measured) for effect in effects)


def _measured(part: Part) -> set[str]:
    """Further channels of an experiment: the plant holds their last values where a record has none."""
    return {name for record in part.experiment.recordings for name in record.extras}
