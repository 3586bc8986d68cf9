"""A film that is wide at its bars and narrow at its waist."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.errors import RigError
from deatwin.plant.film import AnyFilm, FilmPoint, PointwiseFilm
from deatwin.plant.rigs.film_actuator import LIMITS, SIDES, FilmActuator, check_sides, relaxed_stresses
from deatwin.plant.rigs.kinematics import Kinematics, electrode_share

Symbol = Any
HELD = ("clamped", "free")


@dataclass(frozen=True, kw_only=True)
class BowTie(FilmActuator):
    r"""Film with a narrow waist between a fixed and a moving bar; the reading is the elongation of the film.

    .. math:: H w(s)\Bigl(\frac{\partial W}{\partial\lambda}
              - \varepsilon\frac{V^2}{H^2}\lambda\lambda_s^2\Bigr) = F \quad\text{at all } s, \qquad
              x = L\int_0^1\lambda\,ds, \qquad w = w_0 + (w_1 - w_0)\,s

    The coordinate s runs from 0 at the waist to 1 at a bar. The film is symmetric about the waist. H is the thickness
    before stretching, w the width before stretching, W the strain energy density, :math:`\varepsilon` the permittivity,
    V the voltage, F the dead load and x the elongated length. :math:`\lambda` is the stretch along the motion, and
    :math:`\lambda_s` the stretch across it. The film is treated as strips in series, each of which carries the whole
    dead load. Shear between neighbouring strips is neglected, as is permissible if the width
    changes gradually along the film.

    With ``"clamped"`` sides, stiff fibres across the film hold :math:`\lambda_s` constant (pure shear). With ``"free"``
    sides, each strip contracts freely across the motion (uniaxial stress), and the elongation under voltage is small.

    The outline and the sides are assumptions, because no drawings of published bow-tie actuators were available. The
    rig has no frame of hinged bars that turns sideways expansion into elongation.

    Parameters
    ----------
    length : float
        L, the length along the motion before stretching, m.
    waist_width, bar_width : float
        :math:`w_0, w_1`, the widths at the waist and at the bars before stretching, m.
    prestretch : float
        Stretch along the motion, without voltage, of a strip of the mean width. The dead load is computed from this
        stretch with the published material values, and is then constant.
    side_prestretch : float, or None
        Stretch across the motion, which clamped sides hold constant; None for the value of `prestretch`. With free
        sides it must be None, because free strips contract to :math:`\lambda^{-1/2}`.
    sides : {"clamped", "free"}
        Support of the sides.
    stations : int
        Number of Gauss points between the waist and a bar.
    mass : float
        Mass of the moving part, kg.
    damping : float
        Damping constant of the moving part, N s/m; a starting value for a fit.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.
    """

    length: float = 40e-3
    waist_width: float = 20e-3
    bar_width: float = 60e-3
    prestretch: float = 1.5
    side_prestretch: float | None = 3.0
    sides: str = "clamped"
    stations: int = 4
    damping: float = 3.0

    kind: ClassVar[str] = "bow_tie"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sides(self.sides, HELD)
        if self.sides == "free" and self.side_prestretch is not None:
            raise RigError(
                f"free sides contract by themselves and hold no side_prestretch of {self.side_prestretch:g}: pass "
                'side_prestretch=None (omit the key in a rig file), or take sides="clamped"'
            )

    @property
    def across(self) -> float:
        """Stretch across the motion, without voltage, of a strip of the mean width."""
        if self.sides == "free":
            return self.prestretch**-0.5
        return self.prestretch if self.side_prestretch is None else self.side_prestretch

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        along, _ = relaxed_stresses(self.substance, self.prestretch, self.across)
        return (("load", along * self.thickness * (self.waist_width + self.bar_width) / 2, "N"),)

    @property
    def _size(self) -> float:
        return self.length

    @property
    def _rest_position(self) -> float:
        return self.length * float(self._stations[1] @ self._hanging)

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.across

    @property
    def _watch_limits(self) -> Callable[[AnyFilm, Symbol, Builder], None]:
        return LIMITS[self.sides]

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        places, shares, widths = self._stations
        length, share = build.constant("length", self.length), build.constant("share", shares)
        width = build.constant("widths", widths)
        along = self._along(position / length, share, build)
        points, coordinates = [], along[:-1]
        covered = electrode_share(build)
        for number, (stretch, hanging) in enumerate(zip(along, self._hanging, strict=True)):
            rest = self._across(hanging)
            across, more = SIDES[self.sides](f"side_stretch_{number}", stretch, rest, build)
            volume = length * share[number] * width[number] * build.parameter("thickness")
            place = float(places[number])
            mounted = place * self.prestretch * self.length / 2
            points.append(
                FilmPoint(volume=volume, stretches=(stretch, across), radius=place, coverage=covered, mounted=mounted)
            )
            coordinates += more
        return Kinematics(points=points, coordinates=coordinates, film=PointwiseFilm)

    def _along(self, mean: Symbol, share: Symbol, build: Builder) -> list[Symbol]:
        """Return stretches along the motion: one coordinate per station, except the last, which completes the mean."""
        inner = [build.coordinate(f"stretch_{number}", scale=1.0) for number in range(self.stations - 1)]
        for stretch, hanging in zip(inner, self._hanging, strict=False):
            build.guess(stretch, hanging)
        rest = mean - sum((share[k] * stretch for k, stretch in enumerate(inner)), ca.SX(0))
        return [*inner, rest / share[self.stations - 1]]

    @property
    def _stations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position from waist (0) to bar (1), share of the length, and width of each station."""
        abscissae, weights = np.polynomial.legendre.leggauss(self.stations)
        places = (1 + abscissae) / 2
        return places, weights / 2, self.waist_width + (self.bar_width - self.waist_width) * places

    def _across(self, along: float) -> float:
        """Return the stretch across a strip without voltage, given the one along it."""
        return {"free": along**-0.5, "clamped": self.across}[self.sides]

    @cached_property
    def _hanging(self) -> np.ndarray:
        """Return the stations' stretches under the dead load, for the published values of the film."""
        mean = (self.waist_width + self.bar_width) / 2
        held = relaxed_stresses(self.substance, self.prestretch, self.across)[0] * mean / self._stations[2]
        low, high = np.full(held.size, 0.1), np.full(held.size, 20.0)
        for _ in range(50):
            middle = (low + high) / 2
            more = np.array([self._pull(stretch) for stretch in middle]) < held
            low, high = np.where(more, middle, low), np.where(more, high, middle)
        return (low + high) / 2

    def _pull(self, along: float) -> float:
        """Return the nominal stress along a strip; infinite beyond the film's limit of stretch."""
        try:
            return relaxed_stresses(self.substance, along, self._across(along))[0]
        except RigError:
            return np.inf

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        return -build.parameter("load") * position
