"""Limited stretch of the film's chains."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.film import AnyFilm
from deatwin.plant.laws.energies import gent, neo_hookean
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class StrainStiffening(Effect):
    r"""The film stiffens as its stretch approaches a limit, as in Gent's law.

    .. math:: W \to W - \frac{\mu_s J}{2}\ln\Bigl(1 - \frac{I_1 - 3}{J}\Bigr) - \frac{\mu_s}{2}(I_1 - 3)

    W is the film's strain energy density and :math:`I_1` the first invariant of the deformation. The effect has no
    state. The added energy is the energy of a Gent network minus that of a neo-Hookean network of the same modulus, so
    that it vanishes at small stretch. If the film's material already has a limit of stretch, as Gent's has, the effect
    only shifts that limit.

    Typical for VHB: a :math:`\mu_s` equal to the whole shear modulus of the film (15 to 30 kPa), and J = 90 to 120. At
    a prestretch of 3.5, :math:`I_1 - 3` is 21.5. Signature: the influence on the reading is static and even in the
    voltage. Compared with a film without the effect, the displacement grows less steeply above about 2.5 kV, and the
    ball's natural frequency falls less. An `amplifier_saturation` causes a sharp corner in the curve of displacement
    over voltage, and does not change the natural frequency. A `permittivity_stretch` does not change the film's sag at
    0 V. The effect is off at :math:`\mu_s = 0`.

    Parameters
    ----------
    modulus : float
        :math:`\mu_s`, the shear modulus of the part of the polymer network that stiffens, Pa.
    limit : float
        J, the value of :math:`I_1 - 3` at which the energy becomes infinite.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59, doi:10.5254/1.3538357.
    """

    modulus: float = field(default=5e3, metadata=ranged("Pa", 0.0, 200e3))
    limit: float = field(default=90.0, metadata=ranged("1", 40.0, 1000.0, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "strain_stiffening"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "modulus"
    wording: ClassVar[str] = "The film stiffens towards a stretch limit of {limit}, with a modulus of {modulus}"

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        modulus, limit = self.own("modulus", build), self.own("limit", build)

        def density(stretch_1: Any, stretch_2: Any) -> Any:
            return gent(stretch_1, stretch_2, modulus, limit) - neo_hookean(stretch_1, stretch_2, modulus)

        return signal.with_energy(density)
