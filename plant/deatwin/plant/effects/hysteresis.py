"""Rate-independent hysteresis of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.equations import Builder

__all__ = ["Hysteresis"]


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Effect):
    r"""Bouc-Wen force on the ball, with n = 1.

    .. math:: F = -F_h\,\zeta, \qquad x_h\,\dot\zeta = v - |v|\,\zeta

    (:math:`A = 1, \beta = 1, \gamma = 0`). One state :math:`\zeta` (1) between -1 and 1. Typical: force 1 to
    5 % of the ball's weight, distance 10 to 100 µm. Signature: the width of the loop stays as the frequency
    falls. Off at :math:`F_h = 0`. The magnitude is smoothed, :math:`|v| \approx \sqrt{v^2 + v_0^2} - v_0` with
    :math:`v_0` = 1 µm/s, so that the force has a derivative.

    Parameters
    ----------
    force : float
        :math:`F_h` in N.
    distance : float
        :math:`x_h` in m.

    References
    ----------
    Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249; with these constants it is the solid friction of Dahl (1968).
    """

    force: float = 1e-3
    distance: float = 30e-6

    name: ClassVar[str] = "hysteresis"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    wording: ClassVar[str] = "The motion has rate-independent hysteresis of {force} over {distance}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="force", value=self.force, unit="N", lower=0.0, upper=0.05),
            Parameter(
                name="distance", value=self.distance, unit="m", lower=5e-6, upper=1e-3, scale=Scale.LOGARITHMIC
            ),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        memory = build.state("hysteresis_memory", scale=1.0, start=0.0)
        slow = 1e-6
        velocity = build.signal("velocity")
        speed = ca.sqrt(velocity**2 + slow**2) - slow
        build.rate(memory, velocity - speed * memory, mass=self.own("distance", build))
        return signal - self.own("force", build) * memory
