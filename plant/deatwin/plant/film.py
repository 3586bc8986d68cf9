"""Film of a rig: points with volumes and stretches, energy and capacitance, and Maxwell branches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import casadi as ca
import numpy as np

from deatwin.plant.errors import RigError
from deatwin.plant.laws.breakdown import BreakdownLaw
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.laws.energies import maxwell_branch

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


Symbol = Any
Stretches = Sequence[tuple[Symbol, Symbol]]


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmPoint:
    """A quadrature point of the film."""

    volume: Symbol  # Reference volume, m³
    stretches: tuple[Symbol, Symbol]  # Principal in-plane stretches; meridional and hoop in a round film
    radius: Symbol | None = None
    mounted: Symbol = 0.0  # Radius of the point in the flat film as mounted, m
    coverage: Symbol = 1.0  # Share of the film at the point that the electrode still covers, if it has one
    virtual: tuple[Symbol, Symbol] | None = None

    @property
    def active(self) -> bool:
        """True if there is an electrode here."""
        return self.radius is not None


def film_points(points: Sequence[FilmPoint], build: Builder) -> list[FilmPoint]:
    """Return the points with virtual stretches, with respect to which the stress at each point is known."""
    zeros = build.constant("virtual_stretch", np.zeros(2 * len(points)))
    pairs = [(zeros[2 * k], zeros[2 * k + 1]) for k in range(len(points))]
    return [
        replace(p, stretches=(p.stretches[0] + first, p.stretches[1] + second), virtual=(first, second))
        for p, (first, second) in zip(points, pairs, strict=True)
    ]


def point_capacitances(points: Sequence[FilmPoint], permittivity: Symbol, thickness: Symbol) -> list[Symbol]:
    r"""Return the capacitance of each point, :math:`\varepsilon_r\varepsilon_0(\lambda_1\lambda_2/H)^2\,dV_0`."""
    factor = permittivity * VACUUM_PERMITTIVITY / thickness**2
    return [
        factor * p.coverage * p.volume * (p.stretches[0] * p.stretches[1]) ** 2 if p.active else ca.SX(0)
        for p in points
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class AnyFilm(ABC):
    """Interface of a film for effects at the place *film*; subclasses differ in how branches flow."""

    points: Sequence[FilmPoint]  # Points at which stretches are taken
    elastic: Symbol  # Energy of the equilibrium network, J
    prestretches: tuple[float, float]  # In-plane stretches as mounted, from which the search for rest starts
    relaxing: Symbol = 0.0  # Energy of the branches, J
    capacitances: Sequence[Symbol] = ()  # Contribution of each point to the capacitance, F; 0 without an electrode
    breakdown: BreakdownLaw | None = None  # Law of the field that the film withstands; None if unknown

    @property
    def stored(self) -> Symbol:
        """Stored mechanical energy, J."""
        return self.elastic + self.relaxing

    @property
    def capacitance(self) -> Symbol:
        """Capacitance, F."""
        return sum(self.capacitances, ca.SX(0))

    def force(self, coordinate: Symbol, squared_voltage: Symbol) -> Symbol:
        """Return the film's forces dE/dq - V^2/2 dC/dq at a given voltage, (n, 1), with q = `coordinate`."""
        electric = squared_voltage / 2 * ca.gradient(self.capacitance, coordinate) if self.capacitances else 0
        return ca.gradient(self.stored, coordinate) - electric

    def with_elastic(self, factor: Symbol) -> Self:
        """Return the film with a softer or stiffer equilibrium network."""
        return replace(self, elastic=factor * self.elastic)

    def with_energy(self, density: Callable[[Any, Any], Symbol]) -> Self:
        """Return the film with an additional hyperelastic energy."""
        return replace(self, elastic=self.elastic + sum(p.volume * density(*p.stretches) for p in self.points))

    def with_permittivity(self, factor: Callable[[FilmPoint], Symbol]) -> Self:
        """Return the film with a permittivity that differs between points."""
        if not self.capacitances:
            raise RigError("this rig's film has no electrode, so its permittivity does nothing")
        pairs = zip(self.points, self.capacitances, strict=True)
        return replace(self, capacitances=[factor(p) * c if p.active else c for p, c in pairs])

    @abstractmethod
    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        """Add a Maxwell branch: shear modulus, Pa, and relaxation time, the viscosity over it, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Film(AnyFilm):
    r"""Film of a few coordinates, with one viscous stretch :math:`\xi` per branch for the whole film.

    Each point's law of flow has the viscous potential :math:`2\mu\tau(a^2 + ab + b^2)`, with the rates a and b of the
    logarithms of its two viscous stretches. A film that flows with one of them, :math:`\lambda_i(\xi)`, has the sum of
    these potentials, so

    .. math:: \tau\kappa\,\frac{d\ln\xi}{dt} = -\frac{\partial e}{\partial\ln\xi}, \qquad
              \kappa = \int 4(a^2 + ab + b^2)\,dV_0, \quad a, b = \frac{d\ln\lambda_i}{d\ln\xi}.
    """

    relaxed: Callable[[Any], Stretches]  # Stretches at each point of a film that is relaxed at the viscous stretch

    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        """Add a Maxwell branch of one viscous stretch, with the energy mu e."""
        xi = build.state(f"{name}_stretch", scale=1.0)
        build.guess(xi, self.prestretches[0])
        pairs = list(zip(self.points, self.relaxed(xi), strict=True))
        energy = sum(p.volume * maxwell_branch(p.stretches[0] / c, p.stretches[1] / d) for p, (c, d) in pairs)
        flows = [(p.volume, *(ca.gradient(ca.log(x), xi) for x in relaxed)) for p, relaxed in pairs]
        viscous = sum(4 * volume * (a**2 + a * b + b**2) for volume, a, b in flows)  # kappa / xi²
        build.rate(xi, -ca.gradient(energy, xi) / viscous, mass=time)
        build.displace(name, xi, partial(_unstrained, xi))
        return replace(self, relaxing=self.relaxing + modulus * energy)


def _unstrained(xi: Symbol, strain: Symbol) -> Symbol:
    """Return the viscous stretch without its excess strain."""
    return xi * ca.exp(-strain)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointwiseFilm(AnyFilm):
    """Film whose branches flow at each point independently."""

    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        """Add a Maxwell branch with two viscous stretches at each point: tau d(ln xi_1)/dt = (s_1 - s_2/2) / (3 mu).

        Here l_i = lambda_i/xi_i and s_i = mu [l_i^2 - (l_1 l_2)^-2] (Foo et al., J. Appl. Phys. 111 (2012) 034102,
        doi:10.1063/1.3680878).
        """
        energy = ca.SX(0)
        for number, point in enumerate(self.points):
            viscous = [build.state(f"{name}_stretch_{number}_{axis}", scale=1.0) for axis in (1, 2)]
            first, second = (stretch / xi for stretch, xi in zip(point.stretches, viscous, strict=True))
            across = 1 / (first * second) ** 2
            stresses = (first**2 - across, second**2 - across)
            for xi, along, other, mounted in zip(viscous, stresses, stresses[::-1], self.prestretches, strict=True):
                build.guess(xi, mounted)
                build.rate(xi, xi * (along - other / 2) / 3, mass=time)
                build.displace(name, xi, partial(_unstrained, xi))
            energy += point.volume * maxwell_branch(first, second)
        return replace(self, relaxing=self.relaxing + modulus * energy)
