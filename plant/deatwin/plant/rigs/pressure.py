"""A film in a ring that a constant pressure inflates: voltage lets its apex rise further."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.film import PointwiseFilm
from deatwin.plant.material import Material
from deatwin.plant.rigs.film_actuator import FilmActuator, relaxed_stresses
from deatwin.plant.rigs.kinematics import Kinematics
from deatwin.plant.rigs.revolved import Revolved, matrix, move_with_film

Symbol = Any
SHAPES, POINTS = 3, 5
"""Number of shapes out of the plane, equal to that in it; and number of Gauss points in the square of the radius."""


@dataclass(frozen=True, kw_only=True)
class Pressure(FilmActuator):
    r"""Inflated film in a ring, with electrodes all over; the reading is the rise of the apex under voltage.

    A point of the film has the radius :math:`\rho` before stretching, up to :math:`B_0` at the ring. The variable
    :math:`t = \rho^2/B_0^2` runs from 0 at the apex to 1 at the ring, z is the height of the apex, :math:`\Lambda` the
    prestretch, and :math:`g_k, h_k` are unknowns. After stretching, the point has the radius r and the height z(t):

    .. math:: r = \rho\,\Bigl[\Lambda + (1 - t)\sum_k g_k t^k\Bigr], \qquad
              z(t) = (1 - t)\,\Bigl[z + \sum_{k\ge1} h_k t^k\Bigr] .

    The pressure p does the work :math:`p\int\pi r^2\,dz`. The pressure is constant, as with a regulator, or with a
    chamber that is much larger than the volume under the film. The equations include the inertia of the film in all
    unknowns. A flat film has the first natural frequency of a drum,
    :math:`f_1 = \frac{2.405}{2\pi B}\sqrt{\sigma/\varrho}`, where B is the radius of the ring, :math:`\sigma` the
    stress and :math:`\varrho` the density of the film. Compared with the differential equations of a membrane, the
    errors of the rise and of the pull-in voltage are below 0.5 %, as long as the height of the apex is less than the
    diameter of the ring.

    Parameters
    ----------
    frame_radius : float
        Radius of the ring, m.
    prestretch : float
        Equal-biaxial stretch of the flat film.
    pressure : float
        p, the pressure under the film minus the pressure above it, Pa.
    mass : float
        Additional mass at the apex, kg. Its weight is neglected.
    damping : float
        Damping constant of the apex, N s/m; a starting value for a fit.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Adkins & Rivlin, Phil. Trans. R. Soc. A 244 (1952) 505, doi:10.1098/rsta.1952.0013 (inflation of a sheet).
    """

    material: str | Material = "Elastosil 2030"
    thickness: float = 50e-6
    prestretch: float = 1.2
    frame_radius: float = 20e-3
    pressure: float = 500.0
    mass: float = 0.0
    damping: float = 5e-3

    kind: ClassVar[str] = "pressure"
    model_share: ClassVar[float] = 0.005
    """Rms error due to the assumed shape of the film, divided by the standard deviation of the reading."""

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        return (("pressure", self.pressure, "Pa"),)

    @property
    def _size(self) -> float:
        return self.frame_radius

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.prestretch

    @cached_property
    def _rest_position(self) -> float:
        r"""Return the height of a spherical cap whose tension carries the pressure, :math:`p R = 2 N` at its apex."""
        for ratio in np.linspace(0.0, 1.0, 101)[1:]:
            stretch = self.prestretch * (1 + ratio**2)
            nominal, _ = relaxed_stresses(self.substance, stretch, stretch)
            tension = nominal * self.thickness / stretch
            if 4 * ratio / (1 + ratio**2) * tension >= abs(self.pressure) * self.frame_radius:
                break
        return float(np.sign(self.pressure) * ratio * self.frame_radius)

    @cached_property
    def _film(self) -> Revolved:
        rim, powers = self.frame_radius / self.prestretch, np.arange(SHAPES)[:, None]
        abscissae, weights = np.polynomial.legendre.leggauss(POINTS)
        square = (1 + abscissae) / 2
        rho, shapes = rim * np.sqrt(square), (1 - square) * square**powers
        rates = powers * square ** np.maximum(powers - 1, 0) - (powers + 1) * square**powers  # per unit of the square
        return Revolved(
            radii=rho,
            areas=np.pi * rim**2 * weights / 2,
            hoop=shapes,
            radial=shapes + 2 * square * rates,
            height=shapes,
            slope=2 * rho / rim**2 * rates,
        )

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        others = [build.state(name, scale=scale) for name, scale in self._scales.items()]
        heights, flat = others[: SHAPES - 1], others[SHAPES - 1 :]
        build.guess(flat[0], (self._rest_position / self.frame_radius) ** 2 * self.prestretch)
        points = self._film.points(self.prestretch, flat, [position, *heights], build)
        return Kinematics(points=points, coordinates=others, film=PointwiseFilm)

    def _move(self, velocity: Symbol, shape: Kinematics, forces: Symbol, build: Builder) -> None:
        film = self.substance.density * self._film.inertia
        # Damping by the air is distributed over the film as its mass is.
        move_with_film(velocity, self._scales, film, film, shape, forces, build)

    @property
    def _scales(self) -> dict[str, float]:
        """Return further coordinates with their typical sizes: heights in m, and stretches."""
        heights = {f"height_{k}": self._size for k in range(1, SHAPES)}
        return heights | {f"flat_{k}": 1.0 for k in range(SHAPES)}

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        r"""Return the work of the pressure, :math:`-p\int\pi r^2\,dz`, from the areas of the points."""
        film, area = self._film, build.constant("swept", self._film.areas * self._film.radii / 2)
        heights = ca.vertcat(position, *shape.coordinates[: SHAPES - 1])
        fall = -(matrix("fall", film.slope.T, build) @ heights)
        hoops = ca.vertcat(*(point.stretches[1] for point in shape.points))
        return -build.parameter("pressure") * ca.sum1(area * hoops**2 * fall)
