"""Resistance of the electrodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.electrode_loss import rate_of


@dataclass(frozen=True, kw_only=True)
class ElectrodeRC(Effect):
    r"""The film charges through a resistance, so its voltage lags the amplifier's voltage.

    .. math:: R\,\frac{d}{dt}\bigl[(C(q) + C_p)V\bigr] = V_a - V

    :math:`V_a` is the amplifier's voltage and V the film's voltage. C(q) is the film's capacitance, which depends on
    the film's shape q, and :math:`C_0` is its value at rest. :math:`C_p` is the capacitance in parallel with the film
    behind the resistance R: cable, probe, output filter of a converter. With :math:`\chi`, the
    charge divided by :math:`C_0 + C_p`, the equation is

    .. math:: \tau\dot\chi = V_a - V, \qquad V = \chi/c, \qquad c = 1 + s\,\Bigl(\frac{C(q)}{C_0} - 1\Bigr), \qquad
              s = \frac{C_0}{C_0 + C_p}

    The effect has one state, :math:`\chi` (V). A part of the electrode that
    loses contact (`electrode_loss`) takes along its share of C(q) and of the charge, so that the voltage does not jump.
    Typical: :math:`\tau` is 0.1 ms or less with fresh carbon grease, and 10 to 300 ms with dried grease or a bad
    contact (10 to 100 MΩ, 1 to 3 nF).

    Signature: the lag acts before the film squares the voltage, so harmonics are attenuated. The phase lag grows with
    frequency. It also grows with the voltage, because C(q) grows threefold up to 3 kV. A `delay` attenuates no
    harmonics and does not depend on the voltage. The effect is off at :math:`\tau = 0`, where :math:`V = V_a`.

    Parameters
    ----------
    time : float
        :math:`\tau = R(C_0 + C_p)`, the time constant of charging at rest, s.
    film_share : float
        s, the film's share of :math:`C_0 + C_p`: 1 if the resistance is the electrode's own, 0 for an amplifier lag
        that is independent of the film. The default 0.5 means that cable and probe have the same capacitance as the
        film at rest, about 0.9 nF.

    References
    ----------
    Kirchhoff's laws for a resistance in series with two parallel capacitances.
    """

    time: float = field(default=0.05, metadata=ranged("s", 0.0, 5.0))
    film_share: float = field(default=0.5, metadata=ranged("1", 0.0, 1.0))

    name: ClassVar[str] = "electrode_rc"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "film_voltage"
    strength: ClassVar[str] = "time"
    wording: ClassVar[str] = (
        "The film voltage lags the amplifier with a time constant at rest of {time}, and a share of {film_share} of this time "
        "grows with the film's capacitance"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        left, share = build.signal("electrode_share", otherwise=1.0), self.own("film_share", build)
        whole = build.signal("capacitance") / left
        growth, time = whole / build.at_rest("rest_capacitance", whole) - 1, self.own("time", build)
        charge = build.state("film_charge", scale=1e3)
        voltage = charge / (1 + share * (growth - (1 - left) * (1 + growth)))
        gone = time * share * (1 + growth) * voltage * rate_of(left, build.time)
        build.rate(charge, signal - voltage + gone, mass=time)
        return voltage
