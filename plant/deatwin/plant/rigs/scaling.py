"""Stiffness and gain of a film actuator, to which forces and commands of the catalogue's effects are scaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.sizes import COMMAND, FORCE, MOTION, VOLTAGE, Sizes
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


def scaled_to_film(effect: Effect, rig: Rig, gain: float) -> Effect:
    """Return an effect with its forces and commands in proportion to those that move a film behind an amplifier."""
    strengths = [effect.described(effect.strength), *(site.strength for site in effect.places.values())]
    sizes = _sizes(rig, gain) if any(p is not None and p.unit[0] in "NV" for p in strengths) else None
    return effect if sizes is None else sizes.of(effect)


def command_size(gain: float) -> float:
    """Return the order of the commands, V, for usual voltages at a film behind an amplifier with a `gain`."""
    return COMMAND * _order(VOLTAGE / (gain * COMMAND))


@lru_cache(maxsize=64)
def _sizes(rig: Rig, gain: float) -> Sizes | None:
    """Return the diaphragm's sizes with forces and commands of a rig's order; None if they are the same."""
    # Friction, for example, matters by the displacement that it holds back, force divided by stiffness, and that is
    # micrometres on all actuators, whether a film gives way or a stack does not.
    force, command = _order(stiffness(rig) * MOTION / FORCE), command_size(gain)
    if force == 1.0 and command == COMMAND:
        return None
    return Sizes(force=FORCE * force, command=command, voltage=VOLTAGE)


def _order(ratio: float) -> float:
    """Return the nearest power of ten to a ratio, and 1 if it is unknown."""
    # Each ratio has compiled equations of its own, and the ranges of effects span decades.
    return 10.0 ** float(np.rint(np.log10(ratio))) if np.isfinite(ratio) else 1.0
