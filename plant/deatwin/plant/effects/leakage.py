"""Conduction through the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.laws.dielectric import conduction_density

SERIES_RESISTANCE = 1e9
"""Series resistance over which the voltage drops if no reading states one, ohm: the default of `Leakage`."""


@dataclass(frozen=True, kw_only=True)
class Leakage(Effect):
    r"""A current through the film causes a voltage drop over the series resistance.

    .. math:: V = V_a - R\,I(V), \qquad I = \sum_k \sigma_0\,e^{|E_k|/E_B}E_k\,A_k, \qquad
              E_k = \frac{V}{H}(\lambda_1\lambda_2)_k

    :math:`V_a` is the amplifier's voltage or, with `electrode_rc`, the voltage to which the film has charged. V is the
    film's voltage, an algebraic unknown; the effect has no state. The sum is over the points k of the film under the
    electrode. Point k represents the present area :math:`A_k` and has the field :math:`E_k` and the stretches
    :math:`\lambda_1, \lambda_2`. H is the undeformed thickness and :math:`\sigma_0` the conductivity at low field.
    Typical: a voltage drop below 0.1 % unless :math:`R > 10^9` Ω. With such an R, the drop grows exponentially with the
    field and becomes visible above 2.5 kV.

    Signature: static and even in the voltage. The drop flattens the curve of stroke over voltage at the top, as an
    `amplifier_saturation` with a wide corner does. Unlike saturation, the drop depends on the field, and so on the
    film's stretch. A reading of the current shows leakage directly. If the series resistance is known to be
    :math:`R_s`, the film conducts :math:`R/R_s` times as much as the published law says, and the leakage current is the
    voltage drop divided by :math:`R_s`. The effect is off at R = 0.

    Parameters
    ----------
    resistance : float
        R, the resistance in series with the film, Ω.
    field_scale : float
        :math:`E_B`, the increase of the field over which the conductivity grows by a factor of e, V/m. :math:`\sigma_0`
        is not a parameter, because only the product :math:`R\sigma_0` enters.

    References
    ----------
    Foo, Koh, Keplinger, Kaltseis, Bauer & Suo, J. Appl. Phys. 111 (2012) 094107, doi:10.1063/1.4714557 (form; the
    values are those of `deatwin.plant.laws.conduction_density`).
    """

    resistance: float = field(default=1e9, metadata=ranged("ohm", 0.0, 1e11))
    field_scale: float = field(default=40e6, metadata=ranged("V/m", 10e6, 200e6))

    name: ClassVar[str] = "leakage"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "film_voltage"
    strength: ClassVar[str] = "resistance"
    order: ClassVar[int] = 1
    """After `electrode_rc`, because the current depends on the voltage to which the film has charged."""
    wording: ClassVar[str] = (
        "Leakage through the film, which grows e-fold every {field_scale}, drops voltage over {resistance}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        voltage = build.coordinate("leaking_voltage", scale=1e3)
        thickness, scale = build.own("thickness"), self.own("field_scale", build)
        current = ca.SX(0)
        for point in (p for p in build.signal("film").points if p.active):
            area_stretch = point.stretches[0] * point.stretches[1]
            density = conduction_density(voltage / thickness * area_stretch, field_scale=scale)
            current += density * point.coverage * point.volume / thickness * area_stretch
        build.balance(signal - voltage - self.own("resistance", build) * current)
        build.share(
            "leakage_current", (signal - voltage) / build.signal("series_resistance", otherwise=SERIES_RESISTANCE)
        )
        return voltage
