"""Curvature of the sensor's characteristic."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged


@dataclass(frozen=True, kw_only=True)
class SensorCurvature(Effect):
    r"""The sensor's characteristic is curved: its gain changes with the reading.

    .. math:: y \to y + \kappa y^2

    The effect has no state. y is the reading relative to its value at rest, where the sensor's gain is correct.
    Typical: :math:`\kappa` = 10 to 100 1/m, an error of 1 to 10 % at a reading of 1 mm. Such a curvature arises if a
    laser works at the end of its range, or if its spot wanders over a curved target, such as a ball of 4.5 mm. Signature: the error of the
    reading depends only on the present reading, at all frequencies. A motion without voltage, such as ringing after a
    tap, is distorted as much as a motion under voltage. A `permittivity_stretch` changes only the motion under voltage.
    The effect is off at :math:`\kappa = 0`.

    Parameters
    ----------
    curvature : float
        :math:`\kappa`, the relative change of the reading per metre of reading, 1/m.

    References
    ----------
    Second-order term of a calibration curve.
    """

    curvature: float = field(default=50.0, metadata=ranged("1/m", -1e3, 1e3))

    name: ClassVar[str] = "sensor_curvature"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "curvature"
    order: ClassVar[int] = -10
    """This effect acts on the reading before all others, because the sensor's curve maps the motion itself."""
    wording: ClassVar[str] = "The sensor's gain changes with the reading, by twice {curvature} times the reading"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal + self.own("curvature", build) * signal**2
