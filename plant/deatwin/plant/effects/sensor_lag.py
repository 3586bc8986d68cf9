"""Lag of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, Site, ranged


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    r"""The reading lags the motion, with dynamics of first or second order.

    .. math:: r\,\tau_s^2\ddot y + \tau_s\dot y + y = x

    x is the motion and y the reading. The effect has two states (m): y and :math:`\tau_s\dot y`. With r = 0 the lag is
    of first order, with r = 1/4 it equals two equal first-order lags in series, and with r = 1/2 it is a Butterworth
    filter. With r > 1/4 the step response overshoots.

    Typical: :math:`\tau_s` = 0.1 to 20 ms, from the sensor's averaging. Signature: the reading is delayed, and it is
    attenuated at frequencies above :math:`1/(2\pi\tau_s)`. A `delay` of the command does not attenuate. The lag acts
    after all nonlinearities of the plant, so that each harmonic in the reading lags according to its own frequency. The
    ball's ringing is smaller in the reading, although the ball itself is not damped. The effect is off at
    :math:`\tau_s = 0`, where y = x.

    For a lag of the command, use ``SensorLag().placed("command")`` on a rig without a film, and `electrode_rc` on a rig
    with a film.

    Parameters
    ----------
    time : float
        :math:`\tau_s`, the time by which the reading lags a slow motion, s.
    inertia : float
        r, the coefficient of the second-order term.

    References
    ----------
    Lags of first and second order. At low frequencies, an average over a time T is a lag of :math:`\tau_s = T/2`.
    """

    time: float = field(default=0.01, metadata=ranged("s", 0.0, 2.0))
    inertia: float = field(default=0.0, metadata=ranged("1", 0.0, 1.0))

    name: ClassVar[str] = "sensor_lag"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "time"
    order: ClassVar[int] = 20
    """The lag acts before a `delay` of the reading and before `sensor_saturation`, and after all other effects of the
    sensor."""
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

    def rewrite(self, signal: Any, build: Builder) -> Any:
        time, inertia = self.own("time", build), self.own("inertia", build)
        names = (f"lagged_{self.signal}", f"rise_of_lagged_{self.signal}")
        lagged, rise = (build.state(name, scale=1.0 if self.placed_at else 1e-3) for name in names)
        build.rate(lagged, rise, mass=time)
        build.rate(rise, signal - lagged - rise, mass=inertia * time)
        return lagged
