"""A film in a rig: points with volumes and stretches, its energy and capacitance, and what relaxes in it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import casadi as ca
import numpy as np

from deatwin.plant.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.errors import RigError
from deatwin.plant.material import maxwell_branch

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder

__all__ = ["AnyFilm", "Film", "FilmPoint", "PointwiseFilm", "film_points", "point_capacitances", "relaxation_stiffness"]

Symbol = Any
Stretches = Sequence[tuple[Symbol, Symbol]]


def relaxation_stiffness(relaxed: Callable[[Any], Stretches], volumes: Sequence[float], stretch: float) -> float:
    r"""Curvature :math:`\kappa = \partial^2 e/\partial(\ln\xi)^2` of a branch's energy where it is relaxed.

    Parameters
    ----------
    relaxed : callable
        Stretches at all points for a viscous stretch.
    volumes : sequence of float
        Reference volume of each point, m³.
    stretch : float
        Where to evaluate.

    Returns
    -------
    float
        m³ (the energy is per unit of shear modulus). Central difference of second order.
    """
    step = 1e-4
    here = relaxed(stretch)

    def energy(shift: float) -> float:
        there = relaxed(stretch * float(ca.exp(shift)))
        return sum(
            float(v) * float(maxwell_branch(a / c, b / d))
            for v, (a, b), (c, d) in zip(volumes, here, there, strict=True)
        )

    return (energy(step) - 2 * energy(0.0) + energy(-step)) / step**2


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmPoint:
    """A quadrature point of the film.

    Parameters
    ----------
    volume : casadi.SX or float
        Reference volume, m³.
    stretches : pair of casadi.SX
        Principal in-plane stretches, meridional and hoop where the film is round.
    radius : casadi.SX or float, or None
        Reference radius over that of the electrode, 0 to 1; None for film without an electrode.
    mounted : casadi.SX or float
        Radius at which the point lies in the flat film as mounted, m.
    coverage : casadi.SX or float
        Share of the film here that is under the electrode still, where it has one.
    virtual : pair of casadi.SX, or None
        What may be added to each stretch: constants that are zero, as `film_points` makes them. The derivative
        of an energy by them is the stress here.
    """

    volume: Symbol
    stretches: tuple[Symbol, Symbol]
    radius: Symbol | None = None
    mounted: Symbol = 0.0
    coverage: Symbol = 1.0
    virtual: tuple[Symbol, Symbol] | None = None

    @property
    def active(self) -> bool:
        """Whether there is an electrode here."""
        return self.radius is not None


def film_points(points: Sequence[FilmPoint], build: Builder) -> list[FilmPoint]:
    """The same points, each with virtual stretches, so that the stress in it is known.

    Parameters
    ----------
    points : sequence of FilmPoint
        Of the film.
    build : Builder
        Takes the constants.

    Returns
    -------
    list of FilmPoint
    """
    zeros = build.constant("virtual_stretch", np.zeros(2 * len(points)))
    pairs = [(zeros[2 * k], zeros[2 * k + 1]) for k in range(len(points))]
    return [
        replace(p, stretches=(p.stretches[0] + first, p.stretches[1] + second), virtual=(first, second))
        for p, (first, second) in zip(points, pairs, strict=True)
    ]


def point_capacitances(points: Sequence[FilmPoint], permittivity: Symbol, thickness: Symbol) -> list[Symbol]:
    r"""What each point adds to the capacitance, :math:`\varepsilon_r\varepsilon_0(\lambda_1\lambda_2/H)^2\,dV_0`.

    Parameters
    ----------
    points : sequence of FilmPoint
        Of the film.
    permittivity : symbol
        Relative.
    thickness : symbol
        H of the unstretched film, m.

    Returns
    -------
    list of symbol
        F; 0 where there is no electrode.
    """
    factor = permittivity * VACUUM_PERMITTIVITY / thickness**2
    return [
        factor * p.coverage * p.volume * (p.stretches[0] * p.stretches[1]) ** 2 if p.active else ca.SX(0)
        for p in points
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class AnyFilm(ABC):
    """The film as effects at the place *film* see it, however its branches flow.

    Parameters
    ----------
    points : sequence of FilmPoint
        Where stretches are taken.
    elastic : casadi.SX
        Energy of the equilibrium network, J.
    rest_stretch : float
        Where to look for the relaxed state.
    relaxing : casadi.SX
        Energy of the branches, J.
    capacitances : sequence of casadi.SX
        What each point adds to the capacitance, F; 0 where there is no electrode.
    """

    points: Sequence[FilmPoint]
    elastic: Symbol
    rest_stretch: float
    relaxing: Symbol = 0.0
    capacitances: Sequence[Symbol] = ()

    @property
    def stored(self) -> Symbol:
        """Stored mechanical energy, J."""
        return self.elastic + self.relaxing

    @property
    def capacitance(self) -> Symbol:
        """F."""
        return sum(self.capacitances, ca.SX(0))

    def force(self, coordinate: Symbol, squared_voltage: Symbol) -> Symbol:
        r"""Generalised force of the film against coordinates, at a given voltage.

        .. math:: \frac{\partial E}{\partial q} - \frac{V^2}{2}\frac{\partial C}{\partial q}

        Parameters
        ----------
        coordinate : casadi.SX, shape (n, 1)
            q: one coordinate, or several in a column.
        squared_voltage : casadi.SX
            V², which may itself depend on q: it is not differentiated.

        Returns
        -------
        casadi.SX, shape (n, 1)
            J per unit of q.
        """
        electric = squared_voltage / 2 * ca.gradient(self.capacitance, coordinate) if self.capacitances else 0
        return ca.gradient(self.stored, coordinate) - electric

    def with_elastic(self, factor: Symbol) -> Self:
        """The same film with a softer or stiffer equilibrium network.

        Parameters
        ----------
        factor : symbol
            On its energy; it may depend on time and on coordinates of its own, not on the film's.

        Returns
        -------
        same kind of film
        """
        return replace(self, elastic=factor * self.elastic)

    def with_energy(self, density: Callable[[Any, Any], Symbol]) -> Self:
        """The same film with a further hyperelastic energy.

        Parameters
        ----------
        density : callable
            ``density(stretch_1, stretch_2)``, J/m³.

        Returns
        -------
        same kind of film
        """
        return replace(self, elastic=self.elastic + sum(p.volume * density(*p.stretches) for p in self.points))

    def with_permittivity(self, factor: Callable[[FilmPoint], Symbol]) -> Self:
        """The same film with a permittivity that differs from point to point.

        Parameters
        ----------
        factor : callable
            ``factor(point)`` on the permittivity of a point under the electrode.

        Returns
        -------
        same kind of film

        Raises
        ------
        RigError
            If there is no electrode anywhere.
        """
        if not self.capacitances:
            raise RigError("this rig's film has no electrode, so its permittivity does nothing")
        pairs = zip(self.points, self.capacitances, strict=True)
        return replace(self, capacitances=[factor(p) * c if p.active else c for p, c in pairs])

    @abstractmethod
    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        """Add a Maxwell branch.

        Parameters
        ----------
        name : str
            Of the branch.
        modulus, time : casadi.SX
            Shear modulus in Pa, relaxation time in s.
        build : Builder
            Takes the states.

        Returns
        -------
        same kind of film
            With the branch's energy added.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Film(AnyFilm):
    """A film of a few coordinates, whose branches each have one viscous stretch for the whole film.

    Parameters
    ----------
    points, elastic, rest_stretch, relaxing, capacitances
        As for every `AnyFilm`.
    stretch : casadi.SX
        The coordinate that a branch copies.
    relaxed : callable
        ``relaxed(xi)``: stretches at each point of a film that is relaxed at the viscous stretch `xi`.
    stiffness : float
        `relaxation_stiffness` at rest, m³.
    """

    stretch: Symbol
    relaxed: Callable[[Any], Stretches]
    stiffness: float

    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        r"""Add a Maxwell branch, lumped to one viscous stretch :math:`\xi`.

        .. math:: E = \mu\, e(q, \xi), \qquad
                  \tau\,\frac{d\ln\xi}{dt} = -\frac{1}{\kappa}\frac{\partial e}{\partial\ln\xi}

        The dissipation :math:`\mu(\partial e/\partial\ln\xi)^2/(\kappa\tau)` is never negative.

        Parameters
        ----------
        name : str
            Of the branch.
        modulus, time : casadi.SX
            :math:`\mu` in Pa, :math:`\tau` in s.
        build : Builder
            Takes the state.

        Returns
        -------
        Film
            With the branch's energy added.
        """
        xi = build.state(f"{name}_stretch", scale=1.0)
        build.guess(xi, self.rest_stretch)
        pairs = zip(self.points, self.relaxed(xi), strict=True)
        energy = sum(p.volume * maxwell_branch(p.stretches[0] / c, p.stretches[1] / d) for p, (c, d) in pairs)
        build.rate(xi, -(xi**2) * ca.gradient(energy, xi) / self.stiffness, mass=time)
        return replace(self, relaxing=self.relaxing + modulus * energy)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointwiseFilm(AnyFilm):
    """A film whose branches flow at each point by themselves.

    Parameters
    ----------
    points, elastic, rest_stretch, relaxing, capacitances
        As for every `AnyFilm`.
    """

    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Self:
        r"""Add a Maxwell branch with two viscous stretches :math:`\xi_1, \xi_2` at each point.

        .. math:: \tau\,\frac{d\ln\xi_1}{dt} = \frac{1}{3\mu}\bigl(\sigma_1 - \tfrac12\sigma_2\bigr), \qquad
                  \sigma_i = \mu\,\bigl[(\lambda_i^e)^2 - (\lambda_1^e\lambda_2^e)^{-2}\bigr], \qquad
                  \lambda_i^e = \lambda_i/\xi_i

        and the same with 1 and 2 exchanged: an incompressible viscous flow under the true stress of the spring,
        so the dissipation :math:`(\sigma_1^2 - \sigma_1\sigma_2 + \sigma_2^2)/(3\mu\tau)` is never negative.

        Parameters
        ----------
        name : str
            Of the branch.
        modulus, time : casadi.SX
            :math:`\mu` in Pa, :math:`\tau` in s, the viscosity over the modulus.
        build : Builder
            Takes the states.

        Returns
        -------
        PointwiseFilm
            With the branch's energy added.

        References
        ----------
        Foo et al., J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878.
        """
        energy = ca.SX(0)
        for number, point in enumerate(self.points):
            viscous = [build.state(f"{name}_stretch_{number}_{axis}", scale=1.0) for axis in (1, 2)]
            first, second = (stretch / xi for stretch, xi in zip(point.stretches, viscous, strict=True))
            across = 1 / (first * second) ** 2
            stresses = (first**2 - across, second**2 - across)
            for xi, along, other in zip(viscous, stresses, reversed(stresses), strict=True):
                build.guess(xi, self.rest_stretch)
                build.rate(xi, xi * (along - other / 2) / 3, mass=time)
            energy += point.volume * maxwell_branch(first, second)
        return replace(self, relaxing=self.relaxing + modulus * energy)
