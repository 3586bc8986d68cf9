"""A spring that hardens or softens with the displacement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class CubicStiffness(Effect):
    r"""Duffing's term: a force on the ball proportional to the cube of its displacement from rest.

    .. math:: F = -k_3\,y^3

    No state. Typical: a tenth of the film's own 30 N/m at 0.5 mm, that is :math:`1.2\cdot10^7` N/m³.
    Signature: static and even in the voltage; the loss of stroke grows with the cube of the stroke, and the ball's
    frequency shifts with the amplitude a, by :math:`\tfrac38 k_3a^2/k` relatively. It acts on the ball and leaves the
    sag of the film alone, which `strain_stiffening` lifts. Off at :math:`k_3 = 0`.

    Parameters
    ----------
    stiffness : float
        :math:`k_3` in N/m³; negative for a softening spring.

    References
    ----------
    Nayfeh & Mook, Nonlinear Oscillations (1979), section 2.3.
    """

    stiffness: float = 2e7

    name: ClassVar[str] = "cubic_stiffness"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    wording: ClassVar[str] = "The ball is held by a cubic spring of {stiffness}"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="stiffness", value=self.stiffness, unit="N/m3", lower=-1e9, upper=1e11),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal - self.own("stiffness", build) * build.signal("displacement") ** 3
