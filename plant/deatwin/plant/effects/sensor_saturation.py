"""Clipping of the sensor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import soft_excess


@dataclass(frozen=True, kw_only=True)
class SensorSaturation(Effect):
    r"""The sensor clips the reading at the upper end of its range.

    .. math:: y \to y - s\,p(y - y_l), \qquad p(x) = w\ln(1 + e^{x/w})

    y is the reading. The effect has no state. With s = 1 the reading is clipped at the limit :math:`y_l`; with s < 1
    the sensor's gain is 1 - s beyond the limit. The corner is rounded over w = 1 µm, which is less than the sensor
    noise. There is no lower limit, because the ball rests at the lower end of the range.

    Typical: :math:`y_l` = 0.4 mm, for an analogue output that was scaled to the expected motion. Signature: the reading
    has flat tops without ringing, because the ball moves freely beyond the limit. An `end_stop` instead stops the ball,
    which then rings. The effect is off at s = 0.

    Parameters
    ----------
    share : float
        s, the share of the excess :math:`y - y_l` that is lost, from 0 to 1.
    limit : float
        :math:`y_l`, the reading at which the sensor saturates, m.

    References
    ----------
    Clipped output, as sensor data sheets state it. The rounded corner is a softplus function.
    """

    share: float = field(default=1.0, metadata=ranged("1", 0.0, 1.0))
    limit: float = field(default=0.4e-3, metadata=ranged("m", 1e-6, 20e-3))

    name: ClassVar[str] = "sensor_saturation"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "share"
    threshold: ClassVar[str] = "limit"
    order: ClassVar[int] = 30
    """This effect acts after all other effects of the sensor, because the sensor's output is what clips."""
    wording: ClassVar[str] = "The sensor clips beyond {limit}, where a share of {share} of the excess is lost"
    width: ClassVar[float] = 1e-6
    """w, the width over which the corner is rounded, m."""

    def rewrite(self, signal: Any, build: Builder) -> Any:
        excess = soft_excess(signal - self.own("limit", build), self.width)
        return signal - self.own("share", build) * excess
