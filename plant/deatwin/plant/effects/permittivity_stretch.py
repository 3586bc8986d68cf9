"""Permittivity that changes with the stretch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.film import AnyFilm, FilmPoint
from deatwin.plant.laws.permittivity import stretched


@dataclass(frozen=True, kw_only=True)
class PermittivityStretch(Effect):
    r"""The permittivity depends on the stretch, so that the field causes electrostriction besides Maxwell stress.

    .. math:: \varepsilon(\lambda) = \varepsilon\,\bigl[1 + c(\lambda_1 + \lambda_2 - \lambda_{p1} - \lambda_{p2})\bigr]

    The effect has no state. :math:`\lambda_1, \lambda_2` are the stretches, and :math:`\varepsilon` is the permittivity
    at the prestretch :math:`\lambda_{p1}, \lambda_{p2}`. In direction i, the Maxwell stress :math:`\varepsilon E^2` of
    the field E is multiplied by :math:`1 + \frac12\,\partial\ln\varepsilon/\partial\ln\lambda_i`, because the stress is
    the derivative of an energy that contains the permittivity.

    Typical for VHB: c = -0.08 to 0. At a stretch of 3.5, c = -0.08 reduces the Maxwell stress by 14 %. Signature: the
    change of the reading is static and even in the voltage. The effect resembles a smaller permittivity, but it also
    bends the curve of displacement over voltage, most above 2.5 kV. The film's sag at 0 V does not change, whereas
    `strain_stiffening` changes the sag. The effect is off at c = 0.

    Parameters
    ----------
    slope : float
        c, the change of the permittivity per unit of :math:`\lambda_1 + \lambda_2`, divided by the permittivity at the
        prestretch.

    References
    ----------
    Zhao & Suo, J. Appl. Phys. 104 (2008) 123530, doi:10.1063/1.3031483. The literature quotes their slope for VHB as
    -0.053 relative to the unstretched state. Relative to a prestretch of 3.5, this is c = -0.053/(1 - 0.053(2 x 3.5 -
    2)) = -0.072.
    """

    slope: float = field(default=-0.07, metadata=ranged("1", -0.3, 0.3))

    name: ClassVar[str] = "permittivity_stretch"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "slope"
    wording: ClassVar[str] = "The permittivity changes with the stretch, by {slope} per unit of stretch"

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        slope, (first, second) = self.own("slope", build), signal.prestretches

        def factor(point: FilmPoint) -> Any:
            return stretched(*point.stretches, permittivity=1.0, slope=slope, from_1=first, from_2=second)

        return signal.with_permittivity(factor)
