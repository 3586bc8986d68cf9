"""Slow drift of the sensor's zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class SensorDrift(Effect):
    r"""The sensor's zero drifts during the experiment.

    .. math:: y \to y + a\,(1 - e^{-t/\tau}), \qquad t \ge 0

    No state: the clock is known. Typical: micrometres to a tenth of a millimetre per hour, while the sensor head warms
    up or its mount settles. Signature: the baseline moves without a change of gain, equally at 0 V and under drive;
    `permittivity_drift` instead scales the motion and leaves the sag at 0 V. Off at a = 0.

    Parameters
    ----------
    change : float
        a, the final change, m.
    time : float
        :math:`\tau` in s.

    References
    ----------
    First-order warming of the sensor's head and mount.
    """

    change: float = 50e-6
    time: float = 200.0

    name: ClassVar[str] = "sensor_drift"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "change"
    order: ClassVar[int] = 10
    """Added to what the sensor's curve makes of the motion."""
    wording: ClassVar[str] = "The sensor's zero drifts by {change} with a time constant of {time}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="change", value=self.change, unit="m", lower=-2e-3, upper=2e-3),
            Parameter(name="time", value=self.time, unit="s", lower=20.0, upper=20e3, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        elapsed = ca.fmax(build.time, 0.0)
        return signal + self.own("change", build) * (1 - ca.exp(-elapsed / self.own("time", build)))
