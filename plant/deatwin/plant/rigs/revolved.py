"""A film round about an axis, as a sum of shapes f in its plane and e out of it.

r = rho (Lambda + sum_k g_k f_k(rho)) and z = sum_k h_k e_k(rho), with reference radius rho and prestretch Lambda; then
lambda_1^2 = r'^2 + z'^2 and lambda_2 = r/rho.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.film import FilmPoint
from deatwin.plant.rigs.kinematics import Kinematics, electrode_share

Symbol = Any


def matrix(name: str, table: np.ndarray, build: Builder) -> Symbol:
    """Convert a matrix of constants for a rig's equations. Shapes: `table` (n, m); returns (n, m)."""
    return ca.reshape(build.constant(name, table.ravel(order="F")), *table.shape)


def move_with_film(
    velocity: Symbol,
    scales: Mapping[str, float],
    film: np.ndarray,
    damped: np.ndarray,
    shape: Kinematics,
    forces: Symbol,
    build: Builder,
) -> None:
    """Write the motion of a part, which comes first, and of the film. Shapes: `film`, `damped` (n, n)."""
    speeds = ca.vertcat(velocity, *(build.state(f"{name}_rate", scale=scale) for name, scale in scales.items()))
    mass = matrix("inertia", film, build) * build.parameter("thickness")
    mass[0, 0] += build.parameter("mass")
    drag = -build.parameter("damping") * (matrix("damped", damped / damped[0, 0], build) @ speeds)
    drag[0] = build.place(Place.BALL, "force", drag[0])
    accelerations = ca.solve(mass, drag - forces)
    build.rate(velocity, accelerations[0])
    for number, coordinate in enumerate(shape.coordinates, start=1):
        build.rate(coordinate, speeds[number])
        build.rate(speeds[number], accelerations[number])


@dataclass(frozen=True, kw_only=True, eq=False)
class Revolved:
    """Gauss points of a film in a ring, with the shapes evaluated there."""

    radii: np.ndarray  # shape (n,): Radius of each point in the unstretched film, m
    areas: np.ndarray  # shape (n,): Area that each point represents, m²
    hoop: np.ndarray  # shape (n_g, n): f of each shape in the plane
    radial: np.ndarray  # shape (n_g, n): Derivative of rho f by rho
    height: np.ndarray  # shape (n_h, n): e of each shape out of the plane
    slope: np.ndarray  # shape (n_h, n): Derivative of e by rho, 1/m

    @property
    def inertia(self) -> np.ndarray:
        """Return the film's mass matrix for the speeds of h and g, (n_h + n_g, n_h + n_g)."""
        count = len(self.height)
        whole = np.zeros((count + len(self.hoop),) * 2)
        whole[:count, :count] = (self.height * self.areas) @ self.height.T
        whole[count:, count:] = (self.hoop * self.radii**2 * self.areas) @ self.hoop.T
        return whole

    def points(
        self, prestretch: float, flat: Sequence[Symbol], heights: Sequence[Symbol], build: Builder
    ) -> list[FilmPoint]:
        """Return the film's points, all under the electrode; `flat` and `heights` are the coordinates g and h."""
        count, held = self.radii.size, build.constant("prestretch", prestretch)
        tables = {"hoop": self.hoop, "radial": self.radial, "slope": self.slope}
        hoop, radial, slope = (matrix(name, table.T, build) for name, table in tables.items())
        rho, area = build.constant("radii", self.radii), build.constant("areas", self.areas)
        share, thickness, rim = electrode_share(build), build.parameter("thickness"), build.constant("rim", self.rim)
        first: Symbol
        second, along = held + hoop @ ca.vertcat(*flat), held + radial @ ca.vertcat(*flat)
        first = ca.sqrt(along**2 + (slope @ ca.vertcat(*heights)) ** 2)
        return [
            FilmPoint(
                volume=area[k] * thickness,
                stretches=(first[k], second[k]),
                radius=rho[k] / rim,
                mounted=rho[k] * held,
                coverage=share,
            )
            for k in range(count)
        ]

    @property
    def rim(self) -> float:
        """Return a radius beyond all points, m."""
        return float(np.sqrt(self.radii.max() ** 2 + self.areas[-1] / np.pi))
