"""Slow drift of the sensor's zero or gain, or of the amplifier's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Alone, Builder, Effect, Family, Place, Site, ranged
from deatwin.plant.parameters import Parameter, Scale


def _drifting(what: str, place: Place, signal: str, family: Family, strength: Parameter, order: int = 0) -> Site:
    return Site(
        place=place,
        signal=signal,
        family=family,
        strength=strength,
        order=order,
        alone=Alone.AS_ANOTHER,
        wording=f"The {what} drifts towards a final change of {{change}} with a time constant of {{time}}",
        title=f"drift of the {what}",
    )


GAIN = Parameter(name="change", value=0.01, unit="1", lower=-0.5, upper=0.5)
"""Relative drift of a gain. Laboratory high-voltage amplifiers are specified to 0.01 % an hour; unregulated converters
drift by some per cent. A gain is far steadier than a film's permittivity, so a large drift is hardly the gain's."""
VOLTS = Parameter(name="change", value=0.02, unit="V", lower=-1.0, upper=1.0)


@dataclass(frozen=True, kw_only=True)
class SensorDrift(Effect):
    r"""The sensor's zero drifts during the experiment.

    .. math:: y \to y + a\,(1 - e^{-t/\tau}), \qquad t \ge 0

    ``SensorDrift().placed("command")`` describes a drift of the amplifier's offset, which is added to the command.
    ``placed("command_gain")`` and ``placed("reading_gain")`` describe a drift of the gain of the amplifier or of the
    sensor: the command or the reading s becomes :math:`s\,[1 + a\,(1 - e^{-t/\tau})]`. From a single reading, a drift
    of the amplifier's gain cannot be distinguished from `permittivity_drift`.

    The effect has no state. Typical: a micrometre to a tenth of a millimetre per hour, while the sensor head warms up
    or its mount settles. Signature: all readings shift by the same amount, whatever the voltage. A `permittivity_drift`
    instead scales the displacement under voltage, and does not change the reading at 0 V. The effect is off at a = 0.

    Parameters
    ----------
    change : float
        a, the final change, in the unit of the reading or of the command; for a gain, relative to the gain.
    time : float
        :math:`\tau`, the time constant of the drift, s.

    References
    ----------
    First-order warming of the sensor's head and mount.
    """

    change: float = field(default=50e-6, metadata=ranged("m", -2e-3, 2e-3))
    time: float = field(default=200.0, metadata=ranged("s", 20.0, 20e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "sensor_drift"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "change"
    surroundings: ClassVar[frozenset[str]] = frozenset({"time"})
    order: ClassVar[int] = 10
    """After `sensor_curvature`: the drift is added to the output of the sensor's curve."""
    places: ClassVar[Mapping[str, Site]] = MappingProxyType(
        {
            "reading_gain": _drifting("sensor's gain", Place.SENSOR, "reading", Family.SENSOR, GAIN, order=9),
            "command": _drifting("amplifier's offset", Place.DRIVE, "command", Family.ELECTRICAL, VOLTS),
            "command_gain": _drifting("amplifier's gain", Place.DRIVE, "command", Family.ELECTRICAL, GAIN),
        }
    )
    wording: ClassVar[str] = (
        "The sensor's zero drifts towards a final change of {change} with a time constant of {time}"
    )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        elapsed = ca.fmax(build.time, 0.0)
        change = self.own("change", build) * (1 - ca.exp(-elapsed / self.own("time", build)))
        return signal * (1 + change) if self.placed_at.endswith("gain") else signal + change

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return up to three such effects, with times from a sixteenth of the span of `timepts` (s) to four spans.

        `residual` has no influence.
        """
        known = self.described("time")
        # A much faster drift is over at once; a much slower one is a straight line.
        times = float(np.ptp(timepts)) * np.geomspace(1 / 16, 4.0, 3)
        return tuple(replace(self, time=float(t)) for t in np.unique(np.clip(times, known.lower, known.upper)))
