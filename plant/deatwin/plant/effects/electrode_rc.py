"""Resistance of the electrodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.equations import Builder

__all__ = ["ElectrodeRC"]


@dataclass(frozen=True, kw_only=True)
class ElectrodeRC(Effect):
    r"""The film charges through a resistance, so its voltage lags the amplifier's.

    .. math:: RC\,\dot V = V_a - V

    One state V (V), the film voltage. Fresh carbon grease gives 16 µs; dried grease or a bad contact
    (10 to 100 MΩ) 16 to 160 ms. Signature: acts before the square, so harmonics roll off; phase grows with
    frequency. Off at :math:`RC = 0`, where :math:`V = V_a` exactly.

    Parameters
    ----------
    time : float
        RC in s, with the film's capacitance taken constant.

    References
    ----------
    Kirchhoff's law for a resistance in series with a capacitance.
    """

    time: float = 0.05

    name: ClassVar[str] = "electrode_rc"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "film_voltage"
    strength: ClassVar[str] = "time"
    wording: ClassVar[str] = "The film voltage lags the amplifier with a time constant of {time}"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=5.0),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        voltage = build.state("film_voltage", scale=1e3)
        build.rate(voltage, signal - voltage, mass=self.own("time", build))
        return voltage
