"""Curvature of the sensor's characteristic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class SensorCurvature(Effect):
    r"""The sensor's characteristic is curved: its gain changes with the reading.

    .. math:: y \to y + \kappa y^2

    The effect has no state. The reading y is relative to rest, where the gain is correct. Typical: a light spot that
    wanders on a ball of 4.5 mm, or a laser at the end of its range, gives 10 to 100 1/m, that is 1 to 10 % at 1 mm.
    Signature: static, the same at all frequencies, and as large for motion that no voltage causes (ringing after a tap,
    an added mass). A `permittivity_stretch` does not change such motion. The effect is off at :math:`\kappa = 0`.

    Parameters
    ----------
    curvature : float
        :math:`\kappa`, the relative change of the reading per metre of reading, 1/m.

    References
    ----------
    Second-order term of a calibration curve.
    """

    curvature: float = 50.0

    name: ClassVar[str] = "sensor_curvature"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "curvature"
    order: ClassVar[int] = -10
    """First of all effects on the reading, because the sensor's curve maps the motion itself."""
    wording: ClassVar[str] = "The sensor's gain changes with the reading, by twice {curvature} times the reading"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="curvature", value=self.curvature, unit="1/m", lower=-1e3, upper=1e3),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal + self.own("curvature", build) * signal**2
