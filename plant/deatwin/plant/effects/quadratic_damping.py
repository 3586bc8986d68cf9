"""Drag on the moving film and ball."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged


@dataclass(frozen=True, kw_only=True)
class QuadraticDamping(Effect):
    r"""A drag force proportional to the square of the velocity acts on the ball.

    .. math:: F = -c\,v\,|v|

    F is the drag force and v the ball's velocity. The effect has no state. Typical: c = 0.1 to 10 N s²/m² if air is
    pressed through the gap below the film, or if the ball moves in a liquid. For a disc of 80 mm diameter in free air,
    c is 0.004 N s²/m², too little to be visible in the reading.

    Signature: the effect appears only when the ball is fast, that is after steps and near its resonance. Large
    oscillations decay faster than small ones: the relative loss of amplitude per half period is proportional to the
    amplitude. With the rig's linear `damping`, the relative loss is the same for all amplitudes. The effect is off at
    c = 0.

    Parameters
    ----------
    coefficient : float
        c, the drag force divided by the square of the velocity, N s²/m².

    References
    ----------
    Newton's drag :math:`\tfrac12\rho C_d A v^2`, with 1.2 kg/m³ and :math:`C_d` = 1.2 for a flat disc.
    """

    coefficient: float = field(default=1.0, metadata=ranged("N s2/m2", 0.0, 100.0))

    name: ClassVar[str] = "quadratic_damping"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "coefficient"
    wording: ClassVar[str] = "The motion is damped by a drag of {coefficient} times the square of the velocity"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        velocity = build.signal("velocity")
        return signal - self.own("coefficient", build) * velocity * ca.fabs(velocity)
