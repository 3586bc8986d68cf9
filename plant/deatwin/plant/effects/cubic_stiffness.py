"""A spring that hardens or softens with the displacement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged


@dataclass(frozen=True, kw_only=True)
class CubicStiffness(Effect):
    r"""Duffing's term: a force on the ball proportional to the cube of its displacement from rest.

    .. math:: F = -k_3\,y^3

    The effect has no state. y is the ball's displacement from rest. Typical: :math:`2\cdot10^7` N/m³, so that at y =
    0.5 mm the force is a sixth of the force of a film with the stiffness k = 30 N/m. Signature: static and even in the
    voltage. The loss of stroke grows with the cube of the stroke. In an oscillation of amplitude a, the ball's natural
    frequency is higher by the share :math:`\tfrac38 k_3a^2/k`. The position of rest at 0 V does not change, whereas
    `strain_stiffening` reduces the sag of the film. The effect is off at :math:`k_3 = 0`.

    Parameters
    ----------
    stiffness : float
        :math:`k_3`, the coefficient of the cubic force, N/m³; negative for a softening spring.

    References
    ----------
    Nayfeh & Mook, Nonlinear Oscillations (1979), section 2.3.
    """

    stiffness: float = field(default=2e7, metadata=ranged("N/m3", -1e9, 1e11))

    name: ClassVar[str] = "cubic_stiffness"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    wording: ClassVar[str] = "The ball is held by a cubic spring of {stiffness}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal - self.own("stiffness", build) * build.signal("displacement") ** 3
