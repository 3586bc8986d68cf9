"""Clipping of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.effects.smooth import soft_excess
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class SensorSaturation(Effect):
    r"""The sensor clips the reading at the upper end of its range.

    .. math:: y \to y - s\,p(y - y_l), \qquad p(x) = w\ln(1 + e^{x/w})

    The effect has no state. y is the reading. With s = 1 the reading is clipped at the limit; with a smaller s the
    reading rises less steeply beyond the limit. The corner is rounded over w = 1 µm, less than the sensor noise. There
    is no lower limit: the ball rests at the lower end, so that such a limit would be obvious at 0 V. Typical: an
    analogue output scaled to the expected motion, 0.4 mm. Signature: the reading has a flat top, ringing included,
    while the ball moves on and returns below the limit at full speed; an `end_stop` stops the ball and makes it ring.
    The effect is off at s = 0.

    Parameters
    ----------
    share : float
        s, the share of the excess that is lost.
    limit : float
        :math:`y_l`, the reading at which the sensor saturates, m.

    References
    ----------
    Clipped output, as sensor data sheets state it; corner: softplus.
    """

    share: float = 1.0
    limit: float = 0.4e-3

    name: ClassVar[str] = "sensor_saturation"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "share"
    threshold: ClassVar[str] = "limit"
    order: ClassVar[int] = 30
    """Last of the sensor's effects, because it is the sensor's output that clips."""
    wording: ClassVar[str] = "The sensor clips beyond {limit}, where a share of {share} of the excess is lost"
    width: ClassVar[float] = 1e-6
    """Rounding of the corner, m."""

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="share", value=self.share, unit="1", lower=0.0, upper=1.0),
            Parameter(name="limit", value=self.limit, unit="m", lower=1e-6, upper=20e-3),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        excess = soft_excess(signal - self.own("limit", build), self.width)
        return signal - self.own("share", build) * excess
