"""The rig of the thesis: a prestrained film in a ring, an electrode disc, and a ball that loads its centre.

Three generalised coordinates describe the film: the stretch at the edge of the electrode and the drops of the
electrode disc and of the bare annulus. Lengths with the name *reference* are those of the unstretched film.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.plant.equations import Builder
from deatwin.plant.film import Film, FilmPoint, point_capacitances, relaxation_stiffness
from deatwin.plant.material import Material, material
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure
from deatwin.plant.rigs.rigfile import RigFile

__all__ = ["Ball", "Diaphragm"]

GRAVITY = 9.80665
POINTS = 6
"""Gauss points in each of the two zones: against sixteen, a displacement changes by less than 1 pm (sliding ball)
or 0.06 µm (bonded, 3.4 V), far below the error of the shape functions."""

Symbol = Any
Ball = str
"""``"bonded"``: the film sticks to the ball; ``"sliding"``: it slides on it without friction."""


@dataclass(frozen=True, kw_only=True)
class Diaphragm(Rig):
    """Prestrained film in a ring with a ball at its centre; command in, displacement of the ball out.

    Parameters
    ----------
    material : str
        Name in `deatwin.plant.material.MATERIALS`.
    thickness : float
        Of the film before stretching, m.
    prestretch : float
        Equal-biaxial stretch at which the film was mounted.
    frame_radius, electrode_radius, contact_radius : float
        Of the ring, of the electrode at rest, and of the film's contact with the ball, m.
    mass : float
        Of the ball, kg.
    gain : float
        Film volts per command volt.
    start_ramp, start_hold : float
        Start procedure, s.
    ball : {"bonded", "sliding"}
        How the film sits on the ball.
    ball_is_known : bool
        Whether the experimenter said so; if not, the other form is a rival.
    sample_time, noise, reading, model_error, command_range
        As for every `Rig`.
    """

    material: str = "VHB 4905"
    thickness: float = 0.5e-3
    prestretch: float = 3.5
    frame_radius: float = 40e-3
    electrode_radius: float = 17.5e-3
    contact_radius: float = 3e-3
    mass: float = 3e-3
    gain: float = 800.0
    start_ramp: float = 2.0
    start_hold: float = 3.0
    ball: Ball = "sliding"
    ball_is_known: bool = False
    sample_time: float = 0.02
    noise: float = 2e-6
    model_error: float = 1.2e-6

    kind: ClassVar[str] = "diaphragm"
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"
    model_share: ClassVar[float] = 0.015
    """Against a 120-node membrane the three coordinates err by 1.1 % up to 2.4 kV and 1.4 % at 2.6 kV."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        known: dict[str, Any] = {"source": "rig file", "known": True}
        return (
            *self._material.parameters,
            Parameter(name="damping", value=0.05, unit="N s/m", lower=1e-4, upper=2.0,
                      scale=Scale.LOGARITHMIC, source="damping ratio 0.03 to 0.08 of the ball on the film"),
            Parameter(name="zero", value=0.0, unit="m", lower=-1e-3, upper=1e-3, source="sensor offset"),
            Parameter(name="mass", value=self.mass, unit="kg", lower=1e-6, upper=1.0, **known),
            Parameter(name="gain", value=self.gain, unit="V/V", lower=1e-3, upper=1e5, **known),
            Parameter(name="thickness", value=self.thickness, unit="m", lower=1e-6, upper=0.1, **known),
        )  # fmt: skip

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=self.start_ramp, hold=self.start_hold)

    def rivals(self) -> tuple[Diaphragm, ...]:
        """The other support of the ball, where the experimenter did not say, and the other reading time."""
        other_time = next(t for t in ReadingTime if t is not self.reading)
        rivals = [replace(self, reading=other_time)]
        if not self.ball_is_known:
            other = "sliding" if self.ball == "bonded" else "bonded"
            rivals.append(replace(self, ball=other))
        return tuple(rivals)

    def write(self, build: Builder) -> Symbol:
        stretch = build.coordinate("electrode_stretch", scale=1.0)
        outer_drop = build.coordinate("outer_drop", scale=1e-3)
        deflection = build.state("deflection", scale=1e-3)
        velocity = build.watch("velocity", build.state("velocity", scale=0.05))
        displacement = build.watch("displacement", deflection - build.at_rest("rest_deflection", deflection))
        film = build.place(Place.FILM, "film", self._film(stretch, deflection - outer_drop, outer_drop, build))
        squared = self._squared_voltage(build.share("film", film), build)

        mass = build.parameter("mass")
        friction = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        build.rate(deflection, velocity)
        build.rate(velocity, (mass * GRAVITY - film.force(deflection, squared) + friction) / mass)
        build.balance(film.force(outer_drop, squared) / mass)
        build.balance(film.force(stretch, squared) / mass)
        self._guess_rest(build, stretch, deflection, outer_drop)
        return build.place(Place.SENSOR, "reading", displacement + build.parameter("zero"))

    def _squared_voltage(self, film: Film, build: Builder) -> Symbol:
        """From the command through amplifier and electrode to the square that makes the Maxwell stress, V²."""
        build.watch("capacitance", film.capacitance)
        command = build.place(Place.DRIVE, "command", build.command)
        amplified = build.place(Place.DRIVE, "amplifier_voltage", build.parameter("gain") * command)
        voltage = build.watch("film_voltage", build.place(Place.DRIVE, "film_voltage", amplified))
        effective = build.place(Place.DRIVE, "field_voltage", voltage)
        return build.place(Place.DRIVE, "squared_voltage", effective**2)

    def _film(self, stretch: Symbol, inner: Symbol, outer: Symbol, build: Builder) -> Film:
        geometry = self._geometry.as_symbols(build)
        thickness = build.parameter("thickness")
        drops = (inner, outer)
        points: list[FilmPoint] = []
        for number, zone in enumerate(geometry.zones(self.ball, stretch)):
            for rho, area in geometry.points(number):
                meridional, hoop = zone.flat(rho)
                slope = drops[number] * meridional / (hoop * rho * zone.log_ratio)
                radius = rho / geometry.electrode_reference if number == 0 else None
                stretches = (ca.sqrt(meridional**2 + slope**2), hoop)
                points.append(FilmPoint(volume=area * thickness, stretches=stretches, radius=radius))
        if self.ball == "sliding":
            disc = np.pi * geometry.contact_reference**2 * thickness
            points.append(FilmPoint(volume=disc, stretches=(stretch, stretch), radius=0.0))
        elastic = [build.parameter(p.name) for p in self._material.elastic]
        film = Film(
            points=points,
            elastic=sum(p.volume * self._material.energy(*p.stretches, *elastic) for p in points),
            capacitances=point_capacitances(points, build.parameter("permittivity"), thickness),
            stretch=stretch,
            relaxed=lambda xi: geometry.relaxed(self.ball, xi),
            stiffness=build.constant("relaxation_stiffness", self._stiffness),
            rest_stretch=self.prestretch,
        )
        for branch in self._material.branches:
            modulus, time = build.parameter(branch.modulus.name), build.parameter(branch.time.name)
            film = film.with_branch(branch.name, modulus, time, build)
        return film

    def _guess_rest(self, build: Builder, stretch: Symbol, deflection: Symbol, outer: Symbol) -> None:
        r"""Sag of a uniformly stretched membrane, :math:`z = mg\ln(B/r_c)/(2\pi N)`."""
        stress = build.own("shear_modulus") * (self.prestretch**2 - self.prestretch**-4)
        tension = stress * build.own("thickness") / self.prestretch**2
        per_log = build.own("mass") * GRAVITY / (2 * np.pi * tension)
        build.guess(stretch, self.prestretch)
        build.guess(deflection, per_log * np.log(self.frame_radius / self.contact_radius))
        build.guess(outer, per_log * np.log(self.frame_radius / self.electrode_radius))

    @cached_property
    def _material(self) -> Material:
        return material(self.material)

    @cached_property
    def _geometry(self) -> _Geometry:
        return _Geometry.of(self)

    @cached_property
    def _stiffness(self) -> float:
        geometry = self._geometry
        areas = [area for number in (0, 1) for _, area in geometry.points(number)]
        if self.ball == "sliding":
            areas.append(np.pi * geometry.contact_reference**2)
        return relaxation_stiffness(
            lambda xi: geometry.relaxed(self.ball, xi), [a * self.thickness for a in areas], self.prestretch
        )

    @classmethod
    def from_rig_file(cls, described: RigFile) -> Self:
        """The rig that a rig file describes.

        Parameters
        ----------
        described : RigFile
            As `read_rig` gives it. Where it does not say how the film sits on the ball, the rig has a rival.

        Returns
        -------
        Diaphragm
            Its noise includes the rounding to the sensor's resolution.
        """
        film, load, drive, sensor = described.film, described.load, described.drive, described.sensor
        limits = (drive.command_min, drive.command_max)
        return cls(
            material=film.material, thickness=film.thickness, prestretch=film.prestretch,
            frame_radius=film.frame_diameter / 2, electrode_radius=film.electrode_diameter / 2,
            contact_radius=load.contact_diameter / 2, mass=load.mass, gain=drive.gain,
            start_ramp=drive.start_ramp, start_hold=drive.start_hold,
            ball=film.ball or cls.ball, ball_is_known=film.ball is not None,
            sample_time=1 / sensor.sample_rate,
            command_range=None if None in limits else limits,  # type: ignore[arg-type]
            noise=float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Zone:
    """A ring of the film.

    `flat(rho)` gives the meridional and the hoop stretch of the flat film at a reference radius; `log_ratio`
    is the logarithm of its outer over its inner radius, current.
    """

    flat: Callable[[Symbol], tuple[Symbol, Symbol]]
    log_ratio: Symbol


def _uniform_thickness(inner_ref: Symbol, inner: Symbol, outer_ref: Symbol, outer: Symbol) -> _Zone:
    """r² = alpha rho² + beta: exact for small changes of a prestrained ring."""
    alpha = (outer**2 - inner**2) / (outer_ref**2 - inner_ref**2)
    beta = inner**2 - alpha * inner_ref**2

    def flat(rho: Symbol) -> tuple[Symbol, Symbol]:
        radius = ca.sqrt(alpha * rho**2 + beta)
        return alpha * rho / radius, radius / rho

    return _Zone(flat=flat, log_ratio=ca.log(outer / inner))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Geometry:
    """Radii, in the unstretched film where called *reference*, and Gauss points in ln(radius); m, m²."""

    frame: Symbol
    contact: Symbol
    frame_reference: Symbol
    electrode_reference: Symbol
    contact_reference: Symbol
    radius: tuple[Any, Any]
    area: tuple[Any, Any]

    @classmethod
    def of(cls, rig: Diaphragm) -> Self:
        abscissae, weights = np.polynomial.legendre.leggauss(POINTS)
        edges = np.array([rig.contact_radius, rig.electrode_radius, rig.frame_radius]) / rig.prestretch
        half = np.diff(np.log(edges)) / 2
        radius = [np.exp(np.log(edges[zone]) + half[zone] * (1 + abscissae)) for zone in (0, 1)]
        area = [2 * np.pi * radius[zone] ** 2 * half[zone] * weights for zone in (0, 1)]
        return cls(
            frame=rig.frame_radius, contact=rig.contact_radius, contact_reference=float(edges[0]),
            electrode_reference=float(edges[1]), frame_reference=float(edges[2]),
            radius=(radius[0], radius[1]), area=(area[0], area[1]),
        )  # fmt: skip

    def as_symbols(self, build: Builder) -> _Geometry:
        """The same with symbols, so that rigs of all sizes share compiled code."""
        single = ("frame", "contact", "frame_reference", "electrode_reference", "contact_reference")
        return _Geometry(
            **{name: build.constant(name, getattr(self, name)) for name in single},
            radius=tuple(build.constant(f"radius_{k}", r) for k, r in enumerate(self.radius)),
            area=tuple(build.constant(f"area_{k}", a) for k, a in enumerate(self.area)),
        )

    def points(self, number: int) -> list[tuple[Symbol, Symbol]]:
        """Reference radius and area of each Gauss point of a zone."""
        return [(self.radius[number][k], self.area[number][k]) for k in range(POINTS)]

    def zones(self, ball: Ball, stretch: Symbol) -> tuple[_Zone, _Zone]:
        """Electrode and annulus for a stretch at the electrode's edge."""
        edge = stretch * self.electrode_reference
        annulus = _uniform_thickness(self.electrode_reference, edge, self.frame_reference, self.frame)
        if ball == "sliding":
            ratio = ca.log(self.electrode_reference / self.contact_reference)
            return _Zone(flat=lambda rho: (stretch, stretch), log_ratio=ratio), annulus
        electrode = _uniform_thickness(self.contact_reference, self.contact, self.electrode_reference, edge)
        return electrode, annulus

    def relaxed(self, ball: Ball, xi: Symbol) -> list[tuple[Symbol, Symbol]]:
        """Stretches of a flat film that is relaxed at the viscous stretch `xi`."""
        zones = self.zones(ball, xi)
        flat = [zone.flat(rho) for number, zone in enumerate(zones) for rho, _ in self.points(number)]
        return [*flat, (xi, xi)] if ball == "sliding" else flat
