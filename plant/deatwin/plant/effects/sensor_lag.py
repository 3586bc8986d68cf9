"""Lag of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder

__all__ = ["SensorLag"]


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    r"""The reading follows the motion with a first-order lag.

    .. math:: \tau_s\dot y = x - y

    One state y (m), the lagged reading. Typical: 0.1 to 20 ms of averaging. Signature: as a `delay` with a roll-off
    from :math:`1/(2\pi\tau_s)` on, and behind everything that is not linear, so that each harmonic lags by its own
    frequency; the ball's ringing is damped in the reading only. Off at :math:`\tau_s = 0`, where y = x.

    Parameters
    ----------
    time : float
        :math:`\tau_s` in s.

    References
    ----------
    First-order lag; an average over T lags as :math:`\tau_s = T/2` does at low frequency.
    """

    time: float = 0.01

    name: ClassVar[str] = "sensor_lag"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "time"
    order: ClassVar[int] = 20
    """After all that happens to the light, before the output clips."""
    wording: ClassVar[str] = "The sensor lags with a time constant of {time}"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=2.0),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        reading = build.state("lagged_reading", scale=1e-3)
        build.rate(reading, signal - reading, mass=self.own("time", build))
        return reading
