"""A film in a rig: points with volumes and stretches, its energy, and the branches that relax in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca

from deatwin.plant.material import maxwell_branch

if TYPE_CHECKING:
    from deatwin.plant.equations import Builder

__all__ = ["Film", "relaxation_stiffness"]

Symbol = Any
Stretches = Sequence[tuple[Symbol, Symbol]]


def relaxation_stiffness(
    relaxed: Callable[[Any], Stretches], volumes: Sequence[float], stretch: float
) -> float:
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
class Film:
    """The film as effects at the place *film* see it.

    Parameters
    ----------
    energy : casadi.SX
        Stored energy, J.
    volumes : sequence of casadi.SX
        Reference volume of each quadrature point, m³.
    stretches : sequence of pairs of casadi.SX
        Principal in-plane stretches at each point.
    stretch : casadi.SX
        The coordinate that a branch copies.
    relaxed : callable
        ``relaxed(xi)``: stretches at each point of a film that is relaxed at the viscous stretch `xi`.
    stiffness : float
        `relaxation_stiffness` at rest, m³.
    rest_stretch : float
        Where to look for the relaxed state.
    """

    energy: Symbol
    volumes: Sequence[Symbol]
    stretches: Stretches
    stretch: Symbol
    relaxed: Callable[[Any], Stretches]
    stiffness: float
    rest_stretch: float

    def with_branch(self, name: str, modulus: Symbol, time: Symbol, build: Builder) -> Film:
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
        points = zip(self.volumes, self.stretches, self.relaxed(xi), strict=True)
        energy = sum(v * maxwell_branch(a / c, b / d) for v, (a, b), (c, d) in points)
        build.rate(xi, -(xi**2) * ca.gradient(energy, xi) / self.stiffness, mass=time)
        return replace(self, energy=self.energy + modulus * energy)
