"""Jump of the sensor's zero."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.onset import LATEST, steps_of
from deatwin.plant.effects.smooth import smooth_step


@dataclass(frozen=True, kw_only=True)
class SensorJump(Effect):
    r"""From one time on, all readings are shifted by a constant, for example because the sensor was knocked.

    .. math:: y \to y + \frac{a}{1 + e^{-(t - t_0)/(h/4)}}

    h is the sample time. The effect has no state. The jump is smoothed over about one sample time, so that the reading
    is differentiable with respect to :math:`t_0`. Typical: a of tens of micrometres. Signature: the shift is the same
    at any voltage. An `electrode_loss` instead reduces the displacement under voltage, and does not change the reading
    at 0 V. The effect is off at a = 0.

    Parameters
    ----------
    change : float
        a, the height of the jump, m.
    at : float
        :math:`t_0`, the time of the jump on the experiment's clock, s.
    """

    change: float = field(default=20e-6, metadata=ranged("m", -2e-3, 2e-3))
    at: float = field(default=100.0, metadata=ranged("s", 0.0, LATEST))

    name: ClassVar[str] = "sensor_jump"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "change"
    order: ClassVar[int] = 10
    """After `sensor_curvature`: the jump is added to the output of the sensor's curve."""
    event: ClassVar[str] = "at"
    surroundings: ClassVar[frozenset[str]] = frozenset({"at"})
    wording: ClassVar[str] = "At {at} the sensor's zero jumps by {change}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        width = build.constant("sensor_jump_width", build.signal("sample_time") / 4)
        return signal + self.own("change", build) * smooth_step((build.time - self.own("at", build)) / width)

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        change, at = self.described("change"), self.described("at")
        return tuple(
            replace(self, at=time, change=float(np.clip(height, change.lower, change.upper)))
            for time, height in steps_of(timepts, residual, latest=at.upper)
        )
