"""Clipping of the amplifier."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import soft_excess


@dataclass(frozen=True, kw_only=True)
class AmplifierSaturation(Effect):
    r"""The amplifier gives less voltage than commanded beyond a limit, equally for both polarities.

    .. math:: V \to V - s\,[p(V - V_l) - p(-V - V_l)], \qquad p(x) = w\ln(1 + e^{x/w})

    The effect has no state. V is the amplifier's voltage. With s = 1 the voltage is clipped at the limit; with a
    smaller s the voltage rises less steeply beyond the limit. The corner at the limit is rounded over w. With w = 20 V
    the corner is almost sharp; for an output stage that runs out of current, the corner extends over hundreds of volts.
    Typical: a limit near the top of the range, 2.8 kV.

    Signature: almost no effect at voltages more than 4w below the limit. For s = 1, the voltage has a flat top above
    the limit, at all frequencies and for both polarities. Clipping of the drive does not cut off the ball's ringing,
    whereas an `end_stop` does. `strain_stiffening` bends the response at low voltage already. A saturation with a wide
    corner looks like `leakage`. The effect is off at s = 0.

    Parameters
    ----------
    share : float
        s, the share of the voltage above the limit that is lost.
    limit : float
        :math:`V_l`, the output voltage at which the amplifier saturates, V.
    rounding : float
        w, the range of output voltage over which the corner is rounded, V.

    References
    ----------
    Clipped output, as amplifier data sheets state it. The rounded corner is a softplus function.
    """

    share: float = field(default=1.0, metadata=ranged("1", 0.0, 1.0))
    limit: float = field(default=2.8e3, metadata=ranged("V", 100.0, 20e3))
    rounding: float = field(default=20.0, metadata=ranged("V", 1.0, 1e3))

    name: ClassVar[str] = "amplifier_saturation"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "amplifier_voltage"
    strength: ClassVar[str] = "share"
    threshold: ClassVar[str] = "limit"
    wording: ClassVar[str] = "The amplifier clips beyond {limit}, where a share of {share} of the excess is lost"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        limit, width = self.own("limit", build), self.own("rounding", build)
        excess = soft_excess(signal - limit, width) - soft_excess(-signal - limit, width)
        return signal - self.own("share", build) * excess
