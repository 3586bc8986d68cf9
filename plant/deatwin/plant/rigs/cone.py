"""A film between a rigid disc and a ring, drawn out of its plane to a cone by a mass or a spring."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.errors import RigError
from deatwin.plant.film import PointwiseFilm
from deatwin.plant.material import Material
from deatwin.plant.rigs.diaphragm import GRAVITY
from deatwin.plant.rigs.film_actuator import FilmActuator, relaxed_stresses
from deatwin.plant.rigs.kinematics import Kinematics
from deatwin.plant.rigs.revolved import Revolved

Symbol = Any
SHAPES, POINTS = 3, 6
"""Number of shapes in the plane, equal to that out of it besides the cone itself; and number of Gauss points in the
logarithm of the radius."""


@dataclass(frozen=True, kw_only=True)
class Cone(FilmActuator):
    r"""Annular film with electrodes all over and a rigid disc in the middle; the reading is the disc's displacement.

    A point of the film has the radius :math:`\rho` before stretching, between :math:`\rho_i` at the disc and
    :math:`\rho_o` at the ring. The variable :math:`s = \ln(\rho/\rho_i)/\ln(\rho_o/\rho_i)` runs from 0 at the disc to
    1 at the ring, z is the height of the disc, :math:`\Lambda` the prestretch, and :math:`g_k, h_k` are unknowns. After
    stretching, the point has the radius r and the height z(s):

    .. math:: r = \rho\,\Bigl[\Lambda + s(1 - s)\sum_k g_k (1 - 2s)^k\Bigr], \qquad
              z(s) = z\,(1 - s) + s(1 - s)\sum_k h_k (1 - 2s)^k .

    The weight of the disc and a bias force draw the disc out of the plane of the flat film. The bias force is

    .. math:: F = F_0 - k z + F_s\,\frac{3\sqrt3}{2}\,\frac yd\Bigl(1 - \frac{y^2}{d^2}\Bigr), \qquad y = z - c .

    It is the sum of the forces of a linear spring and of a bistable spring. The linear spring has the stiffness k, and
    exerts the force :math:`F_0` when the film is flat. The bistable spring exerts no force at the heights c - d, c and
    c + d; between c - d and c + d, its largest force is :math:`F_s`. Voltage lowers the tension of the film, so that
    the disc moves further out of the plane. The bistable spring increases this motion. If its negative stiffness
    exceeds the stiffness of the film, the disc snaps.

    The film adds the mass :math:`\int\varrho\,(1-s)^2\,dV_0` to the disc, where :math:`\varrho` is the density and
    :math:`V_0` the volume of the film. Compared with the differential equations of a membrane, the errors of the disc's
    displacement and of the pull-in voltage are below 0.5 %.

    Parameters
    ----------
    frame_radius, disc_radius : float
        Radius of the ring and of the rigid disc, m.
    prestretch : float
        Equal-biaxial stretch of the flat film.
    mass : float
        Mass of the disc and of all that is attached to it, kg. The weight acts in the direction of positive z.
    spring_rate : float
        k, the stiffness of the linear spring, N/m.
    spring_preload : float
        :math:`F_0`, the force of the linear spring when the film is flat, N.
    snap_force : float
        :math:`F_s`, the largest force of the bistable spring, N; 0 for no bistable spring.
    snap_middle, snap_reach : float
        c and d, which determine the heights c - d and c + d of the bistable spring, m.
    damping : float
        Damping constant of the moving part, N s/m; a starting value for a fit.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Hau, York, Rizzello & Seelecke, Smart Mater. Struct. 27 (2018) 074004 (bistable bias of such films; the equations
    were not checked against the paper).
    """

    material: str | Material = "Elastosil 2030"
    thickness: float = 50e-6
    prestretch: float = 1.2
    frame_radius: float = 20e-3
    disc_radius: float = 8e-3
    mass: float = 20e-3
    damping: float = 0.1
    spring_rate: float = 0.0
    spring_preload: float = 0.0
    snap_force: float = 0.0
    snap_middle: float = 3e-3
    snap_reach: float = 2e-3

    kind: ClassVar[str] = "cone"
    model_share: ClassVar[float] = 0.005
    """Rms error due to the assumed shape of the film, divided by the standard deviation of the reading."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.disc_radius < self.frame_radius:
            raise RigError(
                f"a disc of {1e3 * self.disc_radius:g} mm radius does not fit into a ring of "
                f"{1e3 * self.frame_radius:g} mm"
            )

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        units = {"spring_rate": "N/m", "spring_preload": "N", "snap_force": "N", "snap_middle": "m", "snap_reach": "m"}
        return tuple((name, getattr(self, name), unit) for name, unit in units.items())

    @property
    def _size(self) -> float:
        return self.frame_radius - self.disc_radius

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.prestretch

    @cached_property
    def _rest_position(self) -> float:
        """Return the height to which weight and bias move a flat film, which carries them as a straight cone there."""
        circle, values = 2 * np.pi * self.disc_radius * self.thickness / self.prestretch, np.linspace(0.0, 3.0, 301)
        loads = [value for _, value, _ in self._outside]
        side = -1.0 if self._force(0.0, self.mass, *loads) < 0.0 else 1.0
        for ratio in values[1:]:  # flat, a film may balance a bistable spring that would move it at once
            height = float(side * ratio * self._size)
            try:
                along, _ = relaxed_stresses(self.substance, self.prestretch * (1 + ratio**2) ** 0.5, self.prestretch)
            except RigError:
                break
            # At the disc the cone is steepest, and its film bears the whole force.
            steepest = ratio * self._size / (self.disc_radius * np.log(self.frame_radius / self.disc_radius))
            held = circle * along * steepest / (1 + steepest**2) ** 0.5
            if held >= side * float(self._force(height, self.mass, *loads)):
                return height
        return side * self._size

    @staticmethod
    def _force(
        height: Symbol, mass: Symbol, rate: Symbol, preload: Symbol, snap: Symbol, middle: Symbol, reach: Symbol
    ) -> Symbol:
        """Return the force of weight and bias along the motion, N."""
        away = (height - middle) / reach
        return mass * GRAVITY + preload - rate * height + snap * 1.5 * 3**0.5 * away * (1 - away**2)

    @cached_property
    def _film(self) -> Revolved:
        inner, outer = self.disc_radius / self.prestretch, self.frame_radius / self.prestretch
        length = np.log(outer / inner)
        abscissae, weights = np.polynomial.legendre.leggauss(POINTS)
        place, rho = (1 + abscissae) / 2, inner * np.exp(length * (1 + abscissae) / 2)
        arch, skew, powers = place * (1 - place), 1 - 2 * place, np.arange(SHAPES)[:, None]
        shapes = arch * skew**powers
        rates = (skew ** (powers + 1) - 2 * powers * arch * skew ** np.maximum(powers - 1, 0)) / length  # rho d/d rho
        return Revolved(
            radii=rho,
            areas=np.pi * rho**2 * length * weights,
            hoop=shapes,
            radial=shapes + rates,
            height=np.vstack([1 - place, shapes]),
            slope=np.vstack([np.full(POINTS, -1 / length), rates]) / rho,
        )

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        flat, heights = (
            [build.coordinate(f"{name}_{k}", scale=scale) for k in range(SHAPES)]
            for name, scale in (("flat", 1.0), ("height", self._size))
        )
        points = self._film.points(self.prestretch, flat, [position, *heights], build)
        return Kinematics(points=points, coordinates=[*flat, *heights], film=PointwiseFilm)

    def _move(self, velocity: Symbol, shape: Kinematics, forces: Symbol, build: Builder) -> None:
        film = build.constant("film_mass", self.substance.density * self._film.inertia[0, 0])
        friction = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        mass = build.parameter("mass") + film * build.parameter("thickness")
        build.rate(velocity, (friction - forces[0]) / mass)
        for number in range(1, forces.numel()):
            build.balance(forces[number])

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        values = [build.parameter(name) for name in ("mass", *(name for name, _, _ in self._outside))]
        # The force is cubic, so that three Gauss points integrate its work exactly.
        abscissae, weights = np.polynomial.legendre.leggauss(3)
        return -position * sum(
            weight / 2 * self._force(position * (1 + at) / 2, *values)
            for at, weight in zip(abscissae, weights, strict=True)
        )
