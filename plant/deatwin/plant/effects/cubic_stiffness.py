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
    r"""Duffing's term: a force on the ball with the cube of its displacement from rest.

    .. math:: F = -k_3\,y^3

    No state. Typical: the film's own 30 N/m and a tenth of them at 0.5 mm give :math:`1.2\cdot10^7` N/m³.
    Signature: static and even in the voltage; the loss of stroke grows with its third power, and the ball's
    frequency moves with the amplitude, by :math:`\tfrac38 k_3a^2/k` relatively. It acts on the ball, so the film
    below is not stretched less; `strain_stiffening` also lifts the sag. Off at :math:`k_3 = 0`.

    Parameters
    ----------
    stiffness : float
        :math:`k_3` in N/m³; negative where the spring softens.

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
