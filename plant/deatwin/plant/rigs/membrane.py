"""Fine film of a diaphragm: axisymmetric elements whose branches flow independently at each point.

The hoop stretch L = r/rho and the height z are quadratic within an element of s = ln rho, and
lambda_1^2 = (L + dL/ds)^2 + (dz/ds / rho)^2. The Gauss points are those for areas, so that a flat film under equal
stretch balances exactly; displacements converge with the fourth power of the elements' size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.smooth import smooth_step
from deatwin.plant.film import FilmPoint, PointwiseFilm
from deatwin.plant.rigs.kinematics import BallInFilm, Kinematics, electrode_share

Symbol = Any


def membrane(rig: BallInFilm, deflection: Symbol, build: Builder) -> Kinematics:
    """Build the elements from ball to frame: `Diaphragm.elements` under the electrode, half as many in the annulus."""
    edges = np.array([rig.contact_radius, rig.electrode_radius, rig.frame_radius]) / rig.prestretch
    rings = (_Ring.of(edges[0], edges[1], rig.elements), _Ring.of(edges[1], edges[2], (rig.elements + 1) // 2))
    edge = 2 * rig.elements
    prestretch = build.constant("prestretch", rig.prestretch)
    electrode = build.constant("electrode_reference", edges[1])
    thickness = build.parameter("thickness")
    free = _free_nodes(rig, np.concatenate([rings[0].nodes, rings[1].nodes[1:]]), edge, build)
    # A bonded film keeps its stretch at the ball, and every film at the frame, from which heights are counted.
    held = [prestretch] if rig.ball == "bonded" else []
    stretches, heights = [*held, *free["stretch"], prestretch], [deflection, *free["drop"], ca.SX(0)]
    share = electrode_share(build)
    width = build.constant("rim_width", float(np.log(edges[1] / edges[0])) / (8 * rig.elements))

    area = build.constant("electrode_areas", rings[0].area.ravel())
    radii = build.constant("electrode_radii", rings[0].radius.ravel() / edges[1])
    inside = build.constant("contact_share", (edges[0] / edges[1]) ** 2 * np.pi * edges[1] ** 2)

    def passed(radius: Symbol) -> Symbol:
        """Return the relative coverage at a radius, because a moving edge passes over each element smoothly."""
        return smooth_step((ca.sqrt(share) - radius) / width) / smooth_step((1 - radius) / width)

    # The points together cover exactly the area that is left, whatever the number of elements.
    left = share * (ca.sum1(area) + inside) - inside
    scale = 1.0 if isinstance(share, float) else left / ca.dot(area, passed(radii))

    def covered(radius: Symbol) -> Symbol:
        return share if isinstance(share, float) else scale * passed(radius)

    points = [
        FilmPoint(
            volume=area * thickness,
            stretches=pair,
            mounted=rho * prestretch,
            radius=rho / electrode if active else None,
            coverage=covered(rho / electrode),
        )
        for ring, first, active in zip(rings, (0, edge), (True, False), strict=True)
        for pair, rho, area in ring.gauss(stretches[first:], heights[first:], build)
    ]
    disc = build.constant("disc", np.pi * edges[0] ** 2) * thickness
    points.append(FilmPoint(volume=disc, stretches=(stretches[0], stretches[0]), radius=0.0))
    return Kinematics(points=points, coordinates=[*free["stretch"], *free["drop"]], film=PointwiseFilm)


def _free_nodes(rig: BallInFilm, nodes: np.ndarray, edge: int, build: Builder) -> dict[str, list[Symbol]]:
    """Return coordinates of the free nodes from the ball outwards, starting from a slightly sagging flat film."""
    free: dict[str, list[Symbol]] = {"stretch": [], "drop": []}
    for node, reference in enumerate(nodes[:-1]):
        stretch, drop = ("electrode_stretch", "outer_drop") if node == edge else (f"stretch_{node}", f"drop_{node}")
        if node > 0 or rig.ball == "sliding":
            free["stretch"].append(build.coordinate(stretch, scale=1.0))
            build.guess(free["stretch"][-1], rig.prestretch)
        if node > 0:
            free["drop"].append(build.coordinate(drop, scale=1e-3))
            build.guess(free["drop"][-1], rig.sag(reference * rig.prestretch, build))
    return free


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ring:
    """Elements of equal width in ln(radius), with their nodes and Gauss points in reference radius and area."""

    nodes: np.ndarray
    radius: np.ndarray
    area: np.ndarray
    shapes: np.ndarray
    slopes: np.ndarray

    @classmethod
    def of(cls, inner: float, outer: float, elements: int) -> Self:
        width = float(np.log(outer / inner)) / elements
        at, weights = _gauss_points(width)
        middles = inner * np.exp(width * (np.arange(elements) + 0.5))[:, None]
        return cls(
            nodes=inner * np.exp(width / 2 * np.arange(2 * elements + 1)),
            radius=middles * np.exp(width / 2 * at),
            area=np.pi * middles**2 * width * weights,
            shapes=np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2], axis=1),
            slopes=np.stack([at - 0.5, -2 * at, at + 0.5], axis=1) * 2 / width,
        )

    def gauss(
        self, stretches: Sequence[Symbol], heights: Sequence[Symbol], build: Builder
    ) -> Iterator[tuple[tuple[Symbol, Symbol], Symbol, Symbol]]:
        """Return stretches, reference radius and area of each Gauss point, from the values at the nodes."""
        names = ("radius", "area", "shapes", "slopes")
        radius, area, shapes, slopes = (build.constant(name, getattr(self, name).ravel()) for name in names)
        for number in range(self.radius.size):
            element, point = divmod(number, 2)
            near, row = slice(2 * element, 2 * element + 3), slice(3 * point, 3 * point + 3)
            stretch, height = ca.vertcat(*stretches[near]), ca.vertcat(*heights[near])
            hoop = ca.dot(shapes[row], stretch)
            flat = hoop + ca.dot(slopes[row], stretch)
            slope = ca.dot(slopes[row], height) / radius[number]
            yield (ca.sqrt(flat**2 + slope**2), hoop), radius[number], area[number]


def _gauss_points(width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return abscissae in (-1, 1) and weights of the two-point Gauss rule with the weight :math:`e^{wx}`."""
    fine, lengths = np.polynomial.legendre.leggauss(16)
    moments = [float(lengths @ (np.exp(width * fine) * fine**k)) for k in range(4)]
    # The abscissae are the roots of the quadratic that is orthogonal to 1 and x under the weight.
    constant, linear = np.linalg.solve([moments[0:2], moments[1:3]], [-moments[2], -moments[3]])
    half = np.sqrt(linear**2 / 4 - constant)
    at = np.array([-linear / 2 - half, -linear / 2 + half])
    first = (moments[1] - at[1] * moments[0]) / (at[0] - at[1])
    return at, np.array([first, moments[0] - first])
