"""Softening that depends on the largest deformation so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.film import AnyFilm
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class Mullins(Effect):
    r"""The film is softer below the largest deformation that it has undergone (pseudo-elastic Mullins effect).

    .. math:: \frac{\partial E}{\partial q} \to \eta\,\frac{\partial E}{\partial q}, \qquad
              \eta = 1 - s\,\mathrm{erf}\,\frac{p(\hat w - w)}{m}, \qquad
              T\,\dot{\hat w} = p(w - \hat w), \qquad w = \frac{E}{V_0}

    E is the elastic energy of the whole film without its Maxwell branches, q are the film's coordinates and :math:`V_0`
    is the film's volume, so w is the mean energy density. The state :math:`\hat w` (J/m³) is the largest w so far. It
    starts at the value of w at rest and follows a larger w within T = 2 ms. The function p(x) is
    :math:`x^2/(x + m/100)` for x > 0, otherwise 0; it rounds the corner at the maximum, where there is no softening.
    The factor :math:`\eta` multiplies the stresses and depends on q through E alone. The force is therefore
    conservative below the maximum, and a cycle dissipates energy only if it raises the maximum.

    Typical for VHB: a softening of 2 to 10 % in the first cycles. The film of a diaphragm stores 2.5 kJ/m³ more at 2 kV
    than at rest, 12 kJ/m³ more at 2.6 kV, and 40 kJ/m³ more at 3 kV; a strip at a stretch of 2 stores 25 kJ/m³.
    Signature: the film softens only when it is stretched further than ever before. Repeated cycles agree from the
    second on. Rest does not restore the stiffness, whereas the film recovers from `creep`. The effect is off at s = 0.

    Parameters
    ----------
    softening : float
        s, the share of the stress that is lost far below the maximum; 1/r in the notation of Ogden & Roxburgh.
    energy : float
        m, the difference :math:`\hat w - w` at which 84 % of the softening is reached, J/m³.

    References
    ----------
    Ogden & Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861, doi:10.1098/rspa.1999.0431: their law for a
    homogeneous specimen, here with the energy of the whole film.
    """

    softening: float = field(default=0.1, metadata=ranged("1", 0.0, 0.95))
    energy: float = field(default=3e3, metadata=ranged("J/m3", 30.0, 300e3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "mullins"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "softening"
    order: ClassVar[int] = 1
    """After the effects that add elastic energy, and before those that change the energy with time."""
    wording: ClassVar[str] = "The film has softened by up to {softening} below the largest stretch so far ({energy})"
    pursuit: ClassVar[float] = 2e-3
    """Time T within which the state follows the energy density, s."""
    corner: ClassVar[float] = 0.01
    """Rounding of p, in units of m."""

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        energy = self.own("energy", build)
        density = signal.elastic / sum(p.volume for p in signal.points)
        largest = build.state("largest_energy", scale=1e6, start=density)
        beyond = (density - largest) / energy
        build.rate(largest, energy * self._excess(beyond), mass=self.pursuit)
        factor = build.coordinate("mullins_factor", scale=1.0)
        build.guess(factor, 1.0)
        build.balance(factor - 1 + self.own("softening", build) * ca.erf(self._excess(-beyond)))
        return signal.with_elastic(factor)

    def _excess(self, value: Any) -> Any:
        above = ca.fmax(value, 0.0)
        return above**2 / (above + self.corner)
