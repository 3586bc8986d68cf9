"""Lag of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    r"""The reading lags the motion, with dynamics of first or second order.

    .. math:: r\,\tau_s^2\ddot y + \tau_s\dot y + y = x

    Two states (m): y, the lagged reading, and :math:`\tau_s\dot y`. r = 0 is a first-order lag, 1/4 two equal lags in
    series, 1/2 a Butterworth filter; above that the sensor rings. Typical: 0.1 to 20 ms of averaging. Signature: like a
    `delay` with a roll-off above :math:`1/(2\pi\tau_s)`, but behind all nonlinearity, so that each harmonic lags
    according to its own frequency; the ball's ringing is damped in the reading only. Off at :math:`\tau_s = 0`, where
    y = x.

    Parameters
    ----------
    time : float
        :math:`\tau_s` in s, the lag of slow motions.
    inertia : float
        r, the coefficient of the second-order term.

    References
    ----------
    Lags of first and second order; at low frequency an average over T lags as :math:`\tau_s = T/2` does.
    """

    time: float = 0.01
    inertia: float = 0.0

    name: ClassVar[str] = "sensor_lag"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "time"
    order: ClassVar[int] = 20
    """After all that happens to the light, before the output clips."""
    wording: ClassVar[str] = (
        "The sensor lags with a time constant of {time}, and an inertia of {inertia} times its square"
    )

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=2.0),
            Parameter(name="inertia", value=self.inertia, unit="1", lower=0.0, upper=1.0),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        time, inertia = self.own("time", build), self.own("inertia", build)
        reading, rise = build.state("lagged_reading", scale=1e-3), build.state("lagged_rise", scale=1e-3)
        build.rate(reading, rise, mass=time)
        build.rate(rise, signal - reading - rise, mass=inertia * time)
        return reading
