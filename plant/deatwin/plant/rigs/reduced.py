r"""Film of a diaphragm, reduced to four coordinates: stretch of the electrode's edge, two drops, and one for the ball.

Electrode and annulus keep a uniform thickness while flat, :math:`r^2 = \alpha\rho^2 + \beta`, and each falls by a drop,
with z logarithmic in r. A sliding ball adds the stretch at the contact. A bonded one adds a bow
:math:`-b\,s(1 - s)`, :math:`s = \ln(r_a/r)/\ln(r_a/r_c)`, the first term due to a tension that changes with s; without
it the film is too stiff by 17 % at 2.8 kV.

Against the fine film (contact radius 3 mm) displacements err by at most 1.5 % up to 3 kV (sliding), and by 3.5 %
(bonded). A branch relaxes to a flat film: with a film that relaxes strongly, the displacement at 3 kV is 1 % too small
at a prestretch of 1.5, 4 % at 1.2 and 14 % at 1.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Self

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.film import Film, FilmPoint
from deatwin.plant.rigs.kinematics import BallInFilm, Kinematics, electrode_share

Symbol = Any

POINTS = 4
"""Number of Gauss points in each of the two zones. Compared with sixteen, a displacement changes by less than 0.01 µm
(sliding ball) or 0.5 µm (bonded, at 3 kV), which is less than a tenth of the error of the shape functions."""


def reduced(rig: BallInFilm, deflection: Symbol, build: Builder) -> Kinematics:
    """Write the film with three coordinates: stretch at the electrode's edge, drop of the annulus, and bow."""
    geometry = _Geometry.of(rig).as_symbols(build)
    stretch = build.coordinate("electrode_stretch", scale=1.0)
    outer = build.coordinate("outer_drop", scale=1e-3)
    build.guess(stretch, rig.prestretch)
    build.guess(outer, rig.sag(rig.electrode_radius, build))
    support = SUPPORTS[rig.ball](rig, build)
    points = _points(geometry, support, stretch, (deflection - outer, outer), build.parameter("thickness"))
    film = partial(Film, relaxed=partial(_relaxed, rig, geometry))
    return Kinematics(points=points, coordinates=[stretch, outer, support.coordinate], film=film)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Support:
    """Fourth coordinate, which depends on the ball, with the resulting stretch at the contact and bow."""

    coordinate: Symbol
    contact: Symbol
    bow: Symbol


def _sliding(rig: BallInFilm, build: Builder) -> _Support:
    contact = build.coordinate("contact_stretch", scale=1.0)
    build.guess(contact, rig.prestretch)
    return _Support(coordinate=contact, contact=contact, bow=0.0)


def _bonded(rig: BallInFilm, build: Builder) -> _Support:
    bow = build.coordinate("bow", scale=1e-3)
    return _Support(coordinate=bow, contact=build.constant("clamped_stretch", rig.prestretch), bow=bow)


SUPPORTS = {"sliding": _sliding, "bonded": _bonded}


def _relaxed(rig: BallInFilm, geometry: _Geometry, xi: Symbol) -> list[tuple[Symbol, Symbol]]:
    """Return stretches at each point of a flat film that is relaxed at the viscous stretch `xi`."""
    contact = xi if rig.ball == "sliding" else geometry.contact / geometry.contact_reference
    zones = enumerate(geometry.zones(contact, xi))
    return [*(zone.flat(rho) for number, zone in zones for rho in geometry.radii(number)), (contact, contact)]


def _points(
    geometry: _Geometry, support: _Support, stretch: Symbol, drops: tuple[Symbol, Symbol], thickness: Symbol
) -> list[FilmPoint]:
    zones = geometry.zones(support.contact, stretch)
    points = []
    for number, (zone, drop, bow) in enumerate(zip(zones, drops, (support.bow, 0.0), strict=True)):
        for rho, area in zip(geometry.radii(number), geometry.rings(number), strict=True):
            meridional, hoop = zone.flat(rho)
            share = ca.log(zone.outer / (hoop * rho)) / zone.log_ratio
            slope = (drop + bow * (2 * share - 1)) * meridional / (hoop * rho * zone.log_ratio)
            points.append(
                FilmPoint(
                    volume=area * thickness,
                    stretches=(ca.sqrt(meridional**2 + slope**2), hoop),
                    radius=rho / geometry.electrode_reference if number == 0 else None,
                    mounted=rho * geometry.frame / geometry.frame_reference,
                )
            )
    disc = np.pi * geometry.contact_reference**2 * thickness
    return [*points, FilmPoint(volume=disc, stretches=(support.contact, support.contact), radius=0.0)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Zone:
    """A ring of the film; `flat(rho)` gives meridional and hoop stretch of the flat film at a reference radius."""

    flat: Callable[[Symbol], tuple[Symbol, Symbol]]
    outer: Symbol
    log_ratio: Symbol


def _uniform_thickness(inner_ref: Symbol, inner: Symbol, outer_ref: Symbol, outer: Symbol) -> _Zone:
    """Return the map r² = alpha rho² + beta, exact for small changes of a prestretched ring."""
    alpha = (outer**2 - inner**2) / (outer_ref**2 - inner_ref**2)
    beta = inner**2 - alpha * inner_ref**2

    def flat(rho: Symbol) -> tuple[Symbol, Symbol]:
        radius = ca.sqrt(alpha * rho**2 + beta)
        return alpha * rho / radius, radius / rho

    return _Zone(flat=flat, outer=outer, log_ratio=ca.log(outer / inner))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Geometry:
    """Radii, in the unstretched film if named *reference*, and Gauss points in ln(radius); m, m²."""

    frame: Symbol
    contact: Symbol
    frame_reference: Symbol
    electrode_reference: Symbol
    contact_reference: Symbol
    radius: tuple[Any, Any]
    area: tuple[Any, Any]

    @classmethod
    def of(cls, rig: BallInFilm) -> Self:
        edges = np.array([rig.contact_radius, rig.electrode_radius, rig.frame_radius]) / rig.prestretch
        return cls._between(rig.frame_radius, rig.contact_radius, tuple(edges))

    def as_symbols(self, build: Builder) -> _Geometry:
        """Replace the numbers by symbols, so that rigs of all sizes share compiled code."""
        frame, contact = build.constant("frame", self.frame), build.constant("contact", self.contact)
        outer = build.constant("frame_reference", self.frame_reference)
        inner = build.constant("contact_reference", self.contact_reference)
        edge = build.constant("electrode_reference", self.electrode_reference)
        share = electrode_share(build)
        if not isinstance(share, float):
            return _Geometry._between(frame, contact, (inner, edge * ca.sqrt(share), outer))
        return _Geometry(
            frame=frame,
            contact=contact,
            frame_reference=outer,
            contact_reference=inner,
            electrode_reference=edge,
            radius=tuple(build.constant(f"radius_{k}", np.array(r)) for k, r in enumerate(self.radius)),
            area=tuple(build.constant(f"area_{k}", np.array(a)) for k, a in enumerate(self.area)),
        )

    @classmethod
    def _between(cls, frame: Symbol, contact: Symbol, edges: tuple[Symbol, Symbol, Symbol]) -> Self:
        """Return Gauss points between three reference radii."""
        abscissae, weights = np.polynomial.legendre.leggauss(POINTS)
        radius, area = [], []
        for inner, outer in pairwise(edges):
            half = ca.log(outer / inner) / 2
            radius.append([inner * ca.exp(half * (1 + x)) for x in abscissae])
            area.append([2 * np.pi * r**2 * half * w for r, w in zip(radius[-1], weights, strict=True)])
        return cls(
            frame=frame,
            contact=contact,
            contact_reference=edges[0],
            electrode_reference=edges[1],
            frame_reference=edges[2],
            radius=(radius[0], radius[1]),
            area=(area[0], area[1]),
        )

    def radii(self, number: int) -> list[Symbol]:
        """Return the reference radius of each Gauss point of a zone."""
        return [self.radius[number][k] for k in range(POINTS)]

    def rings(self, number: int) -> list[Symbol]:
        """Return the ring area that each Gauss point of a zone represents."""
        return [self.area[number][k] for k in range(POINTS)]

    def zones(self, contact: Symbol, stretch: Symbol) -> tuple[_Zone, _Zone]:
        """Return electrode and annulus for given stretches at the ball and at the electrode's edge."""
        ball, edge = contact * self.contact_reference, stretch * self.electrode_reference
        return (
            _uniform_thickness(self.contact_reference, ball, self.electrode_reference, edge),
            _uniform_thickness(self.electrode_reference, edge, self.frame_reference, self.frame),
        )
