"""Limited stretch of the film's chains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.laws.energies import gent, neo_hookean
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder
    from deatwin.plant.film import AnyFilm


@dataclass(frozen=True, kw_only=True)
class StrainStiffening(Effect):
    r"""The film stiffens towards a limit of stretch, more than a neo-Hookean network of the same modulus does.

    .. math:: W \to W - \frac{\mu_s J}{2}\ln\Bigl(1 - \frac{I_1 - 3}{J}\Bigr) - \frac{\mu_s}{2}(I_1 - 3)

    The effect has no state. W is the film's strain energy density and :math:`I_1` the first invariant of its
    deformation. At small stretch the effect adds nothing. Typical for VHB: :math:`\mu_s` equal to the whole modulus of
    the film, 15 to 30 kPa, with J = 90 to 120; at a prestretch of 3.5, :math:`I_1 - 3` = 21.5. Signature: static and
    even in the voltage; the curve of the stroke bends down above about 2.5 kV, and the ball's frequency falls less with
    the voltage. An `amplifier_saturation` has a corner and does not change the frequency; `permittivity_stretch` does
    not change the sag. In a material that already has a limit of stretch, such as Gent's, the effect only shifts that
    limit. The effect is off at :math:`\mu_s = 0`.

    Parameters
    ----------
    modulus : float
        :math:`\mu_s`, the shear modulus of the part of the network that stiffens, Pa.
    limit : float
        J, the largest possible :math:`I_1 - 3`.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59, doi:10.5254/1.3538357.
    """

    modulus: float = 5e3
    limit: float = 90.0

    name: ClassVar[str] = "strain_stiffening"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "modulus"
    wording: ClassVar[str] = "The film stiffens towards a stretch limit of {limit}, with a modulus of {modulus}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="modulus", value=self.modulus, unit="Pa", lower=0.0, upper=200e3),
            Parameter(name="limit", value=self.limit, unit="1", lower=40.0, upper=1000.0, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        modulus, limit = self.own("modulus", build), self.own("limit", build)

        def density(stretch_1: Any, stretch_2: Any) -> Any:
            return gent(stretch_1, stretch_2, modulus, limit) - neo_hookean(stretch_1, stretch_2, modulus)

        return signal.with_energy(density)
