"""Stiffness of a film actuator, to which the forces of the catalogue's effects are scaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.sizes import FORCE, MOTION, VOLTAGE, Sizes
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.base import Rig


@dataclass(frozen=True, kw_only=True)
class _Push(Effect):
    """A constant force on the moving part."""

    force: float = field(default=0.0, metadata=ranged("N", -1.0, 1.0))

    name: ClassVar[str] = "push"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    wording: ClassVar[str] = "The ball is pushed by {force}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal + self.own("force", build)


def stiffness(rig: Rig) -> float:
    """Return the force per displacement of the moving part at rest, N/m; nan if there is no state of rest."""
    plant = rig.with_effects(_Push())
    rest = rest_state(plant.equations, rig.start.rest_command, plant.free_values)
    position, push = 0, list(plant.parameters.free).index("push.force")
    return 1.0 / abs(float(rest.x_p[position, push])) if rest.found else np.nan


def scaled_to_stiffness(effect: Effect, rig: Rig) -> Effect:
    """Return an effect with its forces in proportion to a rig's stiffness; unchanged if it is no force at any place."""
    # Friction, for example, matters by the displacement that it holds back, force divided by stiffness, and that is
    # micrometres on all actuators, whether a film gives way or a stack does not.
    strengths = [effect.described(effect.strength), *(site.strength for site in effect.places.values())]
    sizes = _sizes(rig) if any(p is not None and p.unit.startswith("N") for p in strengths) else None
    return effect if sizes is None else sizes.of(effect)


@lru_cache(maxsize=64)
def _sizes(rig: Rig) -> Sizes | None:
    """Return the diaphragm's sizes with forces of a rig's order; None if they are the same."""
    # The nearest power of ten: each ratio has compiled equations of its own, and the ranges of forces span decades.
    orders = np.log10(stiffness(rig) * MOTION / FORCE)
    order = int(np.rint(orders)) if np.isfinite(orders) else 0
    return Sizes(force=FORCE * 10.0**order, voltage=VOLTAGE) if order else None
