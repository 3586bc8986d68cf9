"""Lag of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place, Site
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    r"""The reading lags the motion, with dynamics of first or second order.

    .. math:: r\,\tau_s^2\ddot y + \tau_s\dot y + y = x

    x is the motion. The effect has two states (m): y, the lagged reading, and :math:`\tau_s\dot y`. r = 0 is a
    first-order lag, r = 1/4 two equal lags in series, r = 1/2 a Butterworth filter; with a larger r the sensor rings.
    Typical: 0.1 to 20 ms of averaging. Signature: like a `delay` with a roll-off above :math:`1/(2\pi\tau_s)`, but the
    lag acts after all nonlinearities, so that each harmonic lags according to its own frequency; the ball's ringing is
    damped in the reading only. The effect is off at :math:`\tau_s = 0`, where y = x. On a rig without a film, `placed`
    moves the lag to the ``command``; on a rig with a film, use `electrode_rc` instead.

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
    """After all effects on the sensor's light, and before its output clips."""
    places: ClassVar[Mapping[str, Site]] = MappingProxyType(
        {
            "command": Site(
                place=Place.DRIVE,
                signal="command",
                family=Family.ELECTRICAL,
                covered_by="electrode_rc",
                wording="The drive lags with a time constant of {time}, and an inertia of {inertia} times its square",
                title="lag of the drive",
            )
        }
    )
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
        names = (f"lagged_{self.signal}", f"rise_of_lagged_{self.signal}")
        lagged, rise = (build.state(name, scale=1.0 if self.placed_at else 1e-3) for name in names)
        build.rate(lagged, rise, mass=time)
        build.rate(rise, signal - lagged - rise, mass=inertia * time)
        return lagged
