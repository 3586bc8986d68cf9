"""Permittivity that changes with the stretch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.laws.permittivity import stretched
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder
    from deatwin.plant.film import AnyFilm, FilmPoint


@dataclass(frozen=True, kw_only=True)
class PermittivityStretch(Effect):
    r"""The permittivity depends on the stretch, so that the field also acts by electrostriction.

    .. math:: \varepsilon(\lambda) = \varepsilon\,\bigl[1 + c(\lambda_1 + \lambda_2 - \lambda_{p1} - \lambda_{p2})\bigr]

    The effect has no state. :math:`\lambda_1, \lambda_2` are the stretches, and :math:`\varepsilon` is the permittivity
    at the prestretch :math:`\lambda_{p1}, \lambda_{p2}`. The stress is the derivative of the field energy including
    this law, which multiplies the Maxwell stress :math:`\varepsilon E^2` of the field E in direction i by
    :math:`1 + \frac12\,d\ln\varepsilon/d\ln\lambda_i`. Typical for VHB: c = -0.08 to 0, relative to the permittivity at
    the prestretch; the Maxwell stress at a stretch of 3.5 is then up to 14 % smaller. Signature: static and even in the
    voltage; the effect is nearly that of a smaller permittivity, except that the additional stretch bends the curve of
    stroke over voltage, most above 2.5 kV. The sag at 0 V does not change, whereas `strain_stiffening` changes it. The
    effect is off at c = 0.

    Parameters
    ----------
    slope : float
        c, relative change per unit of stretch.

    References
    ----------
    Zhao & Suo, J. Appl. Phys. 104 (2008) 123530, doi:10.1063/1.3031483. Their slope of -0.053 from the unstretched
    state for VHB, as the literature quotes it, is c = -0.053/(1 - 0.053(2 x 3.5 - 2)) = -0.072 from a prestretch of
    3.5.
    """

    slope: float = -0.07

    name: ClassVar[str] = "permittivity_stretch"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "slope"
    wording: ClassVar[str] = "The permittivity changes with the stretch, by {slope} per unit of stretch"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="slope", value=self.slope, unit="1", lower=-0.3, upper=0.3),)

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        slope, (first, second) = self.own("slope", build), signal.prestretches

        def factor(point: FilmPoint) -> Any:
            return stretched(*point.stretches, permittivity=1.0, slope=slope, from_1=first, from_2=second)

        return signal.with_permittivity(factor)
