"""A round electrode in the middle of a prestretched film in a ring: it grows in its plane, and its edge is read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.errors import RigError
from deatwin.plant.film import Film, FilmPoint
from deatwin.plant.material import Material
from deatwin.plant.rigs.film_actuator import FilmActuator
from deatwin.plant.rigs.kinematics import Kinematics, electrode_share
from deatwin.plant.rigs.revolved import matrix, move_with_film

Symbol = Any
INSIDE, AROUND = 3, 8
"""Numbers of Gauss points: under the electrode, in the square of the radius; in the ring, in the logarithm of the
radius. They suffice for a ring ten times as wide as the electrode."""
BENDS = ("bulge", "bump", "lean")
"""Coordinates of the film besides the growth of the electrode's edge: one under the electrode, two in the ring."""


@dataclass(frozen=True, kw_only=True)
class Disc(FilmActuator):
    r"""Round electrode on a film in a ring; the reading is the radial displacement of the electrode's edge.

    The radial displacement of the film is a sum of four shape functions. Their amplitudes are the displacement w of the
    electrode's edge and the unknowns c, :math:`b_1` and :math:`b_2`. Before stretching, a point of the film has the
    radius :math:`\rho`, the electrode has the radius A and the film has the radius :math:`B_0`. :math:`\Lambda` is the
    prestretch. Under the electrode (first equation) and outside it (second equation), the point has the radius

    .. math:: r = \Lambda\rho + \frac{\rho}{A}\,w - c\,\rho\,\Bigl(1 - \frac{\rho^2}{A^2}\Bigr)
              \quad\text{and} \qquad
              r = \Lambda\rho + \frac A\rho\,\frac{B_0^2 - \rho^2}{B_0^2 - A^2}\,w
              + B_0\,s(1 - s)\,[b_1 + b_2(1 - 2s)], \qquad
              s = \frac{\rho - A}{B_0 - A}.

    For a small voltage, c, :math:`b_1` and :math:`b_2` are 0, and the exact displacement is

    .. math:: \frac wa = \frac{p}{A_{11}\,\dfrac{2q}{q-1} - 2p}, \qquad p = \varepsilon E^2, \qquad
              q = (B/a)^2, \qquad A_{11} = \frac{\partial\sigma_1}{\partial\ln\lambda_1} - \sigma .

    Here a and B are the radii of the electrode and of the ring on the mounted film, :math:`\varepsilon` is the
    permittivity, E the field and :math:`\sigma` the film's stress without voltage; :math:`\sigma_1` and
    :math:`\lambda_1` are the stress and the stretch in one direction.

    The film's mass and viscosity act on all four shape functions. Without voltage, the angular frequency
    :math:`\omega_1` of the first radial mode follows from :math:`J_1(\omega_1 B\sqrt{\varrho/A_{11}}) = 0`, as for a
    uniform film; :math:`J_1` is a Bessel function and :math:`\varrho` the density. Compared with the differential
    equations of a membrane, the errors of the displacement and of the pull-in voltage are below 0.4 %, and the error of
    the first mode's frequency is below 1 %. This holds up to the voltage at which the film loses its tension.

    Parameters
    ----------
    frame_radius, electrode_radius : float
        Radius of the ring, and of the electrode without voltage, on the mounted film, m.
    prestretch : float
        Equal-biaxial stretch of the mounted film.
    mass : float
        Additional mass at the electrode's edge, such as that of a marker, kg.
    damping : float
        Damping constant of the edge's motion due to the film's viscosity, N s/m; a starting value for a fit.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Pelrine, Kornbluh, Pei & Joseph, Science 287 (2000) 836, doi:10.1126/science.287.5454.836 (the circular test).
    """

    material: str | Material = "Elastosil 2030"
    thickness: float = 100e-6
    prestretch: float = 1.2
    frame_radius: float = 25e-3
    electrode_radius: float = 10e-3
    mass: float = 0.0
    damping: float = 0.02

    kind: ClassVar[str] = "disc"
    model_share: ClassVar[float] = 0.004
    """Rms error due to the assumed shape of the film, divided by the standard deviation of the reading."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.electrode_radius < self.frame_radius:
            raise RigError(
                f"an electrode of {1e3 * self.electrode_radius:g} mm radius does not fit into a ring of "
                f"{1e3 * self.frame_radius:g} mm"
            )

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        return ()

    @property
    def _size(self) -> float:
        return self.electrode_radius / self.prestretch

    @property
    def _rest_position(self) -> float:
        return self.electrode_radius

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.prestretch

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        (radii, areas), thickness, share = self._points, build.parameter("thickness"), electrode_share(build)
        rho, area = build.constant("radii", radii), build.constant("areas", areas)
        prestretch, size = (
            build.constant("prestretch", self.prestretch),
            build.constant("electrode_reference", self._size),
        )
        motions, slopes = (
            matrix(name, values.T, build) for name, values in zip(("motions", "slopes"), self._shapes, strict=True)
        )

        def stretches(grown: Symbol, bends: list[Symbol]) -> list[tuple[Symbol, Symbol]]:
            """Return meridional and hoop stretch at each point."""
            along, used = ca.vertcat(grown, *bends), slice(0, 1 + len(bends))
            first: Symbol
            first, second = prestretch + slopes[:, used] @ along, prestretch + motions[:, used] @ along / rho
            return [(first[k], second[k]) for k in range(radii.size)]

        bends = [build.state(name, scale=1.0) for name in BENDS]
        points = [
            FilmPoint(
                volume=area[k] * thickness,
                stretches=pair,
                mounted=rho[k] * prestretch,
                radius=rho[k] / size if k < INSIDE else None,
                coverage=share,
            )
            for k, pair in enumerate(stretches(position - prestretch * size, bends))
        ]
        film = partial(Film, relaxed=lambda xi: stretches((xi - prestretch) * size, []))
        return Kinematics(points=points, coordinates=bends, film=film)

    def _move(self, velocity: Symbol, shape: Kinematics, forces: Symbol, build: Builder) -> None:
        (radii, areas), (motions, along) = self._points, self._shapes
        film, around = self.substance.density * (motions * areas) @ motions.T, motions / radii
        # Rates of the two in-plane stretches of an incompressible film, and of the third, which is their sum.
        rates = (along, around, along + around)
        viscous = sum((rate * areas) @ rate.T for rate in rates)
        move_with_film(velocity, dict.fromkeys(BENDS, 1.0), film, viscous, shape, forces, build)

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        return ca.SX(0)

    @property
    def _points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return radius of each Gauss point in the unstretched film, m, and the area that it represents, m²."""
        inner, half = self._size, np.log(self.frame_radius / self.electrode_radius) / 2
        (near, weight), (far, share) = map(np.polynomial.legendre.leggauss, (INSIDE, AROUND))
        inside, around = inner * np.sqrt((1 + near) / 2), inner * np.exp(half * (1 + far))
        areas = [np.pi * inner**2 * weight / 2, 2 * np.pi * around**2 * half * share]
        return np.concatenate([inside, around]), np.concatenate(areas)

    @property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the radial motion at each point per unit of each coordinate, and its radial slope, shapes (4, n)."""
        (rho, _), inner, outer = self._points, self._size, self.frame_radius / self.prestretch
        within, square, clear = rho < inner, (rho / inner) ** 2, outer**2 - inner**2
        place = (rho - inner) / (outer - inner)
        arch, skew, width = place * (1 - place), 1 - 2 * place, outer / (outer - inner)
        inside = (rho / inner, np.ones_like(rho) / inner), (-rho * (1 - square), 3 * square - 1)
        around = (
            (inner / rho * (outer**2 - rho**2) / clear, -inner * (1 + (outer / rho) ** 2) / clear),
            (outer * arch, width * skew),
            (outer * arch * skew, width * (skew**2 - 2 * arch)),
        )
        nothing = (np.zeros_like(rho), np.zeros_like(rho))
        pairs = zip((*inside, nothing, nothing), (around[0], nothing, *around[1:]), strict=True)
        motions, slopes = zip(*(np.where(within, one, other) for one, other in pairs), strict=True)
        return np.stack(motions), np.stack(slopes)
