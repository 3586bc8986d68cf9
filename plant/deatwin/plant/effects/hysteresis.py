"""Rate-independent hysteresis of the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import smooth_magnitude, smooth_sign
from deatwin.plant.effects.spectrum import Spectrum
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Effect):
    r"""Bouc-Wen hysteresis force on the ball, with exponent n = 1.

    .. math:: F = -F_h\,\zeta, \qquad x_h\,\dot\zeta = v - \beta\,|v|\,\zeta - (1 - \beta)\,v\,|\zeta|

    In the usual notation of the Bouc-Wen model, :math:`A = 1` and :math:`\gamma = 1 - \beta`. v is the ball's velocity.
    The effect has one dimensionless state :math:`\zeta`. The absolute values are smoothed so that the force is
    differentiable: :math:`|v| \approx \sqrt{v^2 + v_0^2} - v_0` with :math:`v_0` = 10 nm/s, and likewise
    :math:`|\zeta|` with 1e-4. :math:`\zeta` stays between -1 and 1 if the ball moves faster than about :math:`v_0`; on
    a slower ball, the force can reach :math:`2v_0/v` times :math:`F_h`. After a reversal, the slope of the force
    over the displacement is :math:`1 + (2\beta - 1)|\zeta|` times the slope at :math:`\zeta = 0`. With :math:`\beta` =
    0.5 the force therefore returns to zero along a straight line; with :math:`\beta` = 1 the slope at :math:`F_h` is
    twice the slope at zero. Typical: :math:`F_h` of 1 to 5 % of the ball's weight, :math:`x_h` of 10 to 100 µm.

    Signature: the loop of reading over command keeps its width as the frequency falls to zero, whereas the loop of
    `creep` shrinks. Motions much smaller than :math:`x_h` have no loop, whereas `coulomb_friction` holds the ball
    still. The effect is off at :math:`F_h = 0`.

    Parameters
    ----------
    force : float
        :math:`F_h`, the largest force, N.
    distance : float
        :math:`x_h` in m, the displacement over which the force builds up.
    beta : float
        Shape :math:`\beta` of the loop, dimensionless.

    References
    ----------
    Ismail, Ikhouane & Rodellar, Arch. Comput. Methods Eng. 16 (2009) 161, doi:10.1007/s11831-009-9031-8 (survey of the
    model of Bouc and Wen); with beta = 1 the model is the solid friction of Dahl, AIAA J. 14 (1976) 1675,
    doi:10.2514/3.61511.
    """

    force: float = field(default=1e-3, metadata=ranged("N", 0.0, 0.05, widest=0.3))
    distance: float = field(default=30e-6, metadata=ranged("m", 1e-6, 1e-3, scale=Scale.LOGARITHMIC))
    beta: float = field(default=1.0, metadata=ranged("1", 0.5, 2.0))

    name: ClassVar[str] = "hysteresis"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    becomes: ClassVar[Mapping[str, str]] = MappingProxyType({"distance": "coulomb_friction"})
    wording: ClassVar[str] = "The motion has rate-independent hysteresis of {force} over {distance}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal - self.own("force", build) * self._memory(self.name, self.own("distance", build), build)

    def _memory(self, name: str, distance: Any, build: Builder) -> Any:
        """Add the state of an element whose force builds up over a distance, and return it."""
        memory = build.state(f"{name}_memory", scale=1.0, start=0.0)
        velocity, beta, slow = build.signal("velocity"), self.own("beta", build), 1e-8
        speed, strain = smooth_magnitude(velocity, slow), smooth_magnitude(memory, 1e-4)
        forward = speed * smooth_sign(velocity, slow)  # velocity, smoothed at rest like the speed
        build.rate(memory, velocity - beta * speed * memory - (1 - beta) * forward * strain, mass=distance)
        return memory

    def broadened(self) -> Effect | None:
        """Return hysteresis of elements that yield one after another."""
        return HysteresisSpectrum() if type(self) is Hysteresis else None  # a subclass has a law of its own


@dataclass(frozen=True, kw_only=True)
class HysteresisSpectrum(Spectrum, Hysteresis):
    """Hysteresis of elements that yield one after another; a third of the force builds up over each of the distances.

    Most materials and joints yield gradually (Iwan, J. Appl. Mech. 33 (1966) 893), and so do the models of Prandtl and
    Ishlinskii.
    """

    decades: float = field(default=1.0, metadata=ranged("1", 0.5, 3.0))

    spread: ClassVar[str] = "distance"
    wording: ClassVar[str] = (
        "The motion has rate-independent hysteresis of {force} over {decades} decades of distances around {distance}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        memories = [self._memory(name, distance, build) for name, distance in self.branches(build)]
        return signal - self.own("force", build) / 3 * sum(memories)
