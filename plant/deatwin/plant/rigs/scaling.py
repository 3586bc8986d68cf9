"""Usual displacements, forces and commands of a film actuator, to which the catalogue's effects are scaled."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.sizes import COMMAND, FORCE, MOTION, VOLTAGE, Sizes
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.base import Rig
from deatwin.plant.structure import Structure

FIELD, STRAIN = 75e6, 0.2
"""Largest usual field, V/m, that of the default diaphragm at 3 kV, and largest usual strain of a soft film."""
SMALL = 0.01
"""Share of that field for which displacements are proportional to the voltage squared."""
UNMOVED = 1e-6
"""Displacement of no actuator, relative to the film's length, such as that of a film that is flat but for its weight."""


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


@dataclass(frozen=True, kw_only=True)
class Mounted:
    """A mounted film and its amplifier."""

    gain: float  # Of the amplifier
    thickness: float  # Of the mounted film, m
    size: float  # Displacement for a stretch of one, m


def stiffness(rig: Rig) -> float:
    """Return the force per displacement of the moving part at rest, N/m; nan if there is no state of rest."""
    plant = rig.with_effects(_Push())
    rest = rest_state(plant.equations, rig.start.rest_command, plant.free_values)
    push = list(plant.parameters.free).index("push.force")
    return 1.0 / abs(float(rest.x_p[0, push])) if rest.found else np.nan


def stroke(rig: Rig, film: Mounted) -> float:
    """Return the usual displacement at the largest usual field, m; nan without a state of rest or without motion."""
    # For a small voltage, it is proportional to the voltage squared. A soft film would pull in before that field.
    plant, highest = rig.with_effects(), FIELD * film.thickness / film.gain
    rests = [rest_state(plant.equations, SMALL * command, plant.free_values) for command in (0.0, highest)]
    if not all(rest.found for rest in rests):
        return np.nan
    moved = abs(float(rests[1].x[0] - rests[0].x[0])) / SMALL**2
    return min(moved, STRAIN * film.size) if moved > UNMOVED * film.size else np.nan


def scaled_to_film(effect: Effect, rig: Rig, film: Mounted) -> Effect:
    """Return an effect with its lengths, forces and commands in proportion to those of a film actuator."""
    if rig.sizes is not None:  # stated by a kind of one's own
        return rig.sizes.of(effect)
    described = [*effect.describe(), *(site.strength for site in effect.places.values())]
    units = {name for p in described if p is not None for name in re.findall("[A-Za-z]+", p.unit)}
    if units.isdisjoint(("m", "N", "V")):
        return effect
    base = rig.with_effects()
    sizes = _sizes(Structure.of(rig, (), base.parameters, base.stages), film)
    return effect if sizes is None else sizes.of(effect)


def command_size(gain: float) -> float:
    """Return the order of the commands, V, for usual voltages at a film behind an amplifier with a `gain`."""
    return COMMAND * _order(VOLTAGE / (gain * COMMAND))


@lru_cache(maxsize=64)
def _sizes(base: Structure, film: Mounted) -> Sizes | None:
    """Return sizes of the order of magnitude of a rig, given by its base plant; None if they are the diaphragm's."""
    motion = stroke(base.rig, film) / MOTION
    force = motion * stiffness(base.rig) * MOTION / FORCE
    sizes = Sizes(
        motion=MOTION * _order(motion), force=FORCE * _order(force), command=command_size(film.gain), voltage=VOLTAGE
    )
    return None if sizes == Sizes(voltage=VOLTAGE) else sizes


def _order(ratio: float) -> float:
    """Return the nearest power of ten to a ratio, and 1 if it is unknown or 0."""
    # Each ratio has compiled equations of its own, and the ranges of effects span decades.
    return 10.0 ** float(np.rint(np.log10(ratio))) if 0.0 < ratio < np.inf else 1.0
