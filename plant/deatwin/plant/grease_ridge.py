"""A ridge of dried grease under the ball: rough motion between two deflections, until it is worn down."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import smooth_step
from deatwin.plant.parameters import Scale

_DEFLECTION = ranged("m", 10e-6, 10e-3, scale=Scale.LOGARITHMIC)


@dataclass(frozen=True, kw_only=True)
class GreaseRidge(Effect):
    """Lumps of dried grease of period p that the film drags over the ball: F = -F_g sin(2 pi y/p), y the displacement.

    It acts from y_1 to y_2 and from t_1 to t_2, with logistic ends of d and T. The effect has no state. The ball snaps
    from lump to lump if 2 pi F_g/p exceeds the film's stiffness (law: Iglesias & Gonçalves, arXiv:1708.03414).
    """

    force: float = field(default=1e-3, metadata=ranged("N", 0.0, 0.05))  # Force F_g, N
    lower: float = field(default=0.4e-3, metadata=_DEFLECTION)  # Lower end y_1, displacement from rest, m
    upper: float = field(default=0.5e-3, metadata=_DEFLECTION)  # Upper end y_2, likewise
    built: float = field(default=10.0, metadata=ranged("s", -100.0, 1e4))  # Start t_1, s
    worn: float = field(default=30.0, metadata=ranged("s", -100.0, 1e5))  # End t_2, s

    name: ClassVar[str] = "grease_ridge"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    wording: ClassVar[str] = (
        "From {built} to {worn} the ball runs over a ridge of {force} between deflections of {lower} and {upper}"
    )
    pitch: ClassVar[float] = 50e-6  # Period p of the lumps, m
    edge: ClassVar[float] = 2e-6  # Width d of the ends, m
    growth: ClassVar[float] = 0.5  # Width T of start and end, s

    def rewrite(self, signal: Any, build: Builder) -> Any:
        displacement = build.signal("displacement")
        here = _between(displacement, self.own("lower", build), self.own("upper", build), self.edge)
        now = _between(build.time, self.own("built", build), self.own("worn", build), self.growth)
        return signal - self.own("force", build) * ca.sin(2 * np.pi * displacement / self.pitch) * here * now


def _between(value: Any, lower: Any, upper: Any, width: float) -> Any:
    return smooth_step((value - lower) / width) * smooth_step((upper - value) / width)
