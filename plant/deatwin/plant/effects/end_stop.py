"""A stop below the ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.effects.smooth import soft_excess
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder

__all__ = ["EndStop"]


@dataclass(frozen=True, kw_only=True)
class EndStop(Effect):
    r"""The ball touches something elastic beyond a position, and does not bounce off it.

    .. math:: F = -k\,d\,\Bigl(1 + \frac{v}{\sqrt{v^2 + v_c^2}}\Bigr), \qquad
              d = w\ln\bigl(1 + e^{(y - y_s)/w}\bigr)

    No state. y is the displacement from rest, downwards; d is how far the ball has gone in, with the first touch
    rounded over w = 5 µm. In slow contact the force is k d; faster than :math:`v_c` = 5 mm/s the way in costs
    twice that and the way out gives nothing back, so that the stop takes energy and never pulls. Typical: 100 N/m
    for foam; 3 kN/m is 100 times the film's stiffness :math:`k_f` and as good as a wall, and a ball that rings on
    anything harder cannot be followed with 50 samples a second. Signature: nothing below :math:`y_s`; above, the
    stroke grows by only :math:`k_f/(k_f + k)` of what it would, at any voltage and frequency, and the ball's
    ringing is cut on one side. An `amplifier_saturation` cuts the drive, so the ball still swings through. Off at
    k = 0.

    Parameters
    ----------
    stiffness : float
        k in N/m.
    position : float
        :math:`y_s` in m.

    References
    ----------
    Force proportional to depth times a function of speed: Hunt & Crossley, J. Appl. Mech. 42 (1975) 440,
    doi:10.1115/1.3423596; here that function stays between 0 and 2.
    """

    stiffness: float = 300.0
    position: float = 0.25e-3

    name: ClassVar[str] = "end_stop"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    threshold: ClassVar[str] = "position"
    wording: ClassVar[str] = "The ball meets a stop of {stiffness} at {position}"
    width: ClassVar[float] = 5e-6
    """w in m."""
    impact: ClassVar[float] = 5e-3
    """:math:`v_c` in m/s."""

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="stiffness", value=self.stiffness, unit="N/m", lower=0.0, upper=3e3),
            Parameter(
                name="position", value=self.position, unit="m", lower=50e-6, upper=20e-3, scale=Scale.LOGARITHMIC
            ),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        depth = soft_excess(build.signal("displacement") - self.own("position", build), self.width)
        velocity = build.signal("velocity")
        direction = velocity / ca.sqrt(velocity**2 + self.impact**2)
        return signal - self.own("stiffness", build) * depth * (1 + direction)
