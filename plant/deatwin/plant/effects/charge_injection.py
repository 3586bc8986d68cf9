"""Space charge in the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class ChargeInjection(Effect):
    r"""Charge injected slowly from the electrodes into the film weakens the field.

    .. math:: V \to V - V_q, \qquad \tau_q\dot V_q = bV - V_q

    V is the film voltage. The effect has one state :math:`V_q` (V), the voltage of the space charge, which is initially
    zero. Typical: b = 0.01 to 0.1, :math:`\tau_q` = 10 to :math:`10^4` s.

    Signature: after a step of V, the force falls to :math:`(1-b)^2` of its first value, whereas `dielectric_absorption`
    and `creep` make the motion grow. After V returns to 0, the remaining charge still causes a force proportional to
    :math:`(bV)^2`. After a reversal of polarity, the force starts at :math:`(1+b)^2` of its value without space charge.
    The response therefore depends on the sign of the present voltage, but it does not change if the sign of the whole
    history is reversed. The effect is off at b = 0.

    Parameters
    ----------
    share : float
        b, the share of a constant voltage that the space charge finally cancels.
    time : float
        :math:`\tau_q`, the time constant of the injection, s.

    References
    ----------
    Homocharge with first-order kinetics, the lowest-order form; the sizes are typical for polymer films and are not
    confirmed for VHB.
    """

    share: float = field(default=0.05, metadata=ranged("1", 0.0, 0.5))
    time: float = field(default=100.0, metadata=ranged("s", 1.0, 20e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "charge_injection"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "field_voltage"
    strength: ClassVar[str] = "share"
    remembers: ClassVar[str] = "V"
    wording: ClassVar[str] = (
        "Injected charge weakens the electric field by a share of {share}, with a time constant of {time}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        injected = build.state("injected_voltage", scale=100.0)
        share = self.own("share", build)
        build.rate(injected, share * signal - injected, mass=self.own("time", build))
        build.displace(self.name, injected, lambda excess: injected - share * excess)
        return signal - injected
