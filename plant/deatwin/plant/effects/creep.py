"""Creep of the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.spectrum import Spectrum
from deatwin.plant.film import Film
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class Creep(Effect):
    r"""A further Maxwell branch: the film keeps relaxing after the nominal branch has relaxed.

    .. math:: W \to W + \mu_c\, e(\lambda/\xi), \qquad
              \tau_c\,\frac{d\ln\xi}{dt} = -\frac{1}{\kappa}\frac{\partial e}{\partial\ln\xi}

    W is the film's strain energy density and :math:`\lambda` the film's stretch. The effect has one dimensionless
    state, the viscous stretch :math:`\xi` (two states at each point of a film that is divided into elements). e is the
    neo-Hookean energy of the branch's spring for a modulus of 1, and :math:`\kappa` is the curvature of e in the
    relaxed state. Typical for VHB: 10 to 60 kPa, 6 to 500 s; the stroke for a constant voltage is 15 to 20 % larger
    than at 1 Hz. Signature: after each change of the mean voltage the motion continues slowly, nearly in proportion to
    the change of the squared voltage, and the film recovers when the voltage returns. With `dielectric_absorption`, the
    electrical stress continues to change even if the film is blocked; `permittivity_drift` does not recover. The effect
    is off at :math:`\mu_c = 0`.

    Parameters
    ----------
    modulus : float
        :math:`\mu_c`, the shear modulus of the branch, Pa.
    time : float
        :math:`\tau_c`, the relaxation time of the branch, s.

    References
    ----------
    Foo et al., J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878; values: Wang et al., J. Mech. Phys.
    Solids 95 (2016) 213.
    """

    modulus: float = field(default=26e3, metadata=ranged("Pa", 0.0, 1e6))
    time: float = field(default=60.0, metadata=ranged("s", 2.0, 2000.0, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "creep"
    family: ClassVar[Family] = Family.FILM
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "modulus"
    remembers: ClassVar[str] = "1"
    wording: ClassVar[str] = "The film keeps creeping with a relaxation time of {time}"

    def rewrite(self, signal: Film, build: Builder) -> Film:
        return signal.with_branch(self.name, self.own("modulus", build), self.own("time", build), build)

    def broadened(self) -> Effect | None:
        """Return creep with a spectrum of relaxation times."""
        return CreepSpectrum() if type(self) is Creep else None  # a subclass has a law of its own


@dataclass(frozen=True, kw_only=True)
class CreepSpectrum(Spectrum, Creep):
    r"""Creep with a spectrum of relaxation times, as most elastomers have it.

    .. math:: W \to W + \frac{\mu_c}{3} \sum_{k=-1}^{1} e(\lambda/\xi_k), \qquad \tau_k = \tau_c\, 10^{k d/2}

    `time` is the centre of the spectrum, and d is `decades`. Each branch obeys the law of `Creep`.
    """

    time: float = field(default=60.0, metadata=ranged("s", 0.05, 2000.0, scale=Scale.LOGARITHMIC))

    wording: ClassVar[str] = "The film keeps creeping with relaxation times over {decades} decades around {time}"

    def rewrite(self, signal: Film, build: Builder) -> Film:
        for branch, time in self.branches(build):
            signal = signal.with_branch(branch, self.own("modulus", build) / 3, time, build)
        return signal
