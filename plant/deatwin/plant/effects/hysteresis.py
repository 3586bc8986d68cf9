"""Rate-independent hysteresis of the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.effects.smooth import smooth_magnitude
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder

__all__ = ["Hysteresis"]


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Effect):
    r"""Bouc-Wen force on the ball, with n = 1.

    .. math:: F = -F_h\,\zeta, \qquad x_h\,\dot\zeta = v - |v|\,\zeta + \kappa\,v\,|\zeta|

    (:math:`A = 1, \beta = 1, \gamma = -\kappa`). One state :math:`\zeta` (1), between :math:`\pm 1/(1 - \kappa)` as
    long as the ball moves faster than some 10 nm/s: magnitudes are smoothed, :math:`|v| \approx \sqrt{v^2 + v_0^2} -
    v_0` with :math:`v_0` = 10 nm/s and that of :math:`\zeta` with 1e-4, so that the force has a derivative, and a
    slower ball is held by up to :math:`2v_0/v` times the force. Where the motion turns, the force falls at
    :math:`1 + (1 + \kappa)\zeta` times the rate at which it rises from rest: at twice that rate for :math:`\kappa = 0`,
    along a straight line for -1, where :math:`\beta = \gamma`. Up to 1 either way it is sure to take energy. Typical:
    force 1 to 5 % of the ball's weight, distance 10 to 100 µm. Signature: the width of the loop stays as the
    frequency falls to zero, where that of `creep` shrinks; motions much smaller than the distance have no loop, where
    `coulomb_friction` holds the ball still. Off at :math:`F_h = 0`.

    Parameters
    ----------
    force : float
        :math:`F_h` in N.
    distance : float
        :math:`x_h` in m.
    hardening : float
        :math:`\kappa`.

    References
    ----------
    Ismail, Ikhouane & Rodellar, Arch. Comput. Methods Eng. 16 (2009) 161, doi:10.1007/s11831-009-9031-8 (survey
    of the model of Bouc and Wen); without hardening it is the solid friction of Dahl, AIAA J. 14 (1976) 1675,
    doi:10.2514/3.61511.
    """

    force: float = 1e-3
    distance: float = 30e-6
    hardening: float = 0.0

    name: ClassVar[str] = "hysteresis"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    becomes: ClassVar[Mapping[str, str]] = MappingProxyType({"distance": "coulomb_friction"})
    wording: ClassVar[str] = "The motion has rate-independent hysteresis of {force} over {distance}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="force", value=self.force, unit="N", lower=0.0, upper=0.05),
            Parameter(
                name="distance", value=self.distance, unit="m", lower=5e-6, upper=1e-3, scale=Scale.LOGARITHMIC
            ),
            Parameter(name="hardening", value=self.hardening, unit="1", lower=-1.0, upper=0.9),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        memory = build.state("hysteresis_memory", scale=1.0, start=0.0)
        velocity = build.signal("velocity")
        speed, strain = smooth_magnitude(velocity, 1e-8), smooth_magnitude(memory, 1e-4)
        change = velocity - speed * memory + self.own("hardening", build) * velocity * strain
        build.rate(memory, change, mass=self.own("distance", build))
        return signal - self.own("force", build) * memory
