"""Film of a rig: points and stretches as functions of the rig's coordinates, material, and voltage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.film import AnyFilm, FilmPoint, PointwiseFilm, film_points, point_capacitances
from deatwin.plant.material import Material
from deatwin.plant.supply import Supply

Symbol = Any
SomeFilm = TypeVar("SomeFilm", bound=AnyFilm)
MIDDLE = 0.5**0.5  # Radius of a uniform film's only point, as a share of the electrode's; half of the area lies within


@dataclass(frozen=True, kw_only=True, eq=False)
class Kinematics:
    """A film as a function of the rig's coordinates."""

    points: Sequence[FilmPoint]  # Points at which stretches are taken, in terms of the coordinates
    coordinates: Sequence[Symbol]  # Algebraic coordinates, each of which needs a balance
    film: Callable[..., AnyFilm]


class BallInFilm(Protocol):
    """Interface of a rig with a ball at the centre of a film in a ring, such as `Diaphragm`; lengths in m."""

    @property
    def ball(self) -> str: ...
    @property
    def thickness(self) -> float: ...
    @property
    def prestretch(self) -> float: ...
    @property
    def frame_radius(self) -> float: ...
    @property
    def electrode_radius(self) -> float: ...
    @property
    def contact_radius(self) -> float: ...
    @property
    def elements(self) -> int: ...
    def sag(self, radius: float, build: Builder) -> Symbol: ...


def electrode_share(build: Builder) -> Symbol:
    """Return the share of the electrode's area that still has contact."""
    return build.share("electrode_share", build.place(Place.FILM, "electrode_share", 1.0))


def uniform_film(
    volume: Symbol, stretches: tuple[Symbol, Symbol], build: Builder, coordinates: Sequence[Symbol] = ()
) -> Kinematics:
    """Return a film that has the same stretches everywhere."""
    point = FilmPoint(volume=volume, stretches=stretches, radius=MIDDLE, coverage=electrode_share(build))
    return Kinematics(points=[point], coordinates=coordinates, film=PointwiseFilm)


def material_film(shape: Kinematics, substance: Material, prestretches: tuple[float, float], build: Builder) -> AnyFilm:
    """Return the film of a rig, before any effect."""
    points = film_points(shape.points, build)
    elastic = [build.parameter(p.name) for p in substance.elastic]
    film = shape.film(
        points=points,
        elastic=sum(p.volume * substance.energy(*p.stretches, *elastic) for p in points),
        capacitances=point_capacitances(points, build.parameter("permittivity"), build.parameter("thickness")),
        prestretches=prestretches,
        breakdown=substance.breakdown,
    )
    return with_branches(film, substance, build)


def with_branches(film: SomeFilm, substance: Material, build: Builder) -> SomeFilm:
    """Return a film with the Maxwell branches of its material."""
    for branch in substance.branches:
        modulus, time = build.parameter(branch.modulus.name), build.parameter(branch.time.name)
        film = film.with_branch(branch.name, modulus, time, build)
    return film


def squared_voltage(film: AnyFilm, build: Builder, supply: Supply | None) -> Any:
    """Return the squared voltage of the Maxwell stress, from the command through amplifier and electrode."""
    build.watch("capacitance", film.capacitance)
    command = build.place(Place.DRIVE, "command", build.command)
    amplified = build.place(Place.DRIVE, "amplifier_voltage", build.parameter("gain") * command)
    supplied = amplified if supply is None else supply.voltage(amplified, film, build)
    voltage = build.watch("film_voltage", build.place(Place.DRIVE, "film_voltage", supplied))
    effective = build.share("field_voltage", build.place(Place.DRIVE, "field_voltage", voltage))
    squared = build.place(Place.DRIVE, "squared_voltage", effective**2)
    offer_electrical(film, effective, build)
    return squared


def offer_electrical(film: AnyFilm, effective: Symbol, build: Builder) -> None:
    """Offer a film's capacitance, with dQ/dV = (1 - a) C, and its current I = d/dt[C ((1 - a) V + a p)] + I_l.

    Slow dipoles (share a, adapted to p) follow no bridge. A part of the electrode that loses contact keeps its charge,
    which does not flow through the lead. `effective` is the voltage of the field, less that of space charge.
    """
    left, instant = build.signal("electrode_share", otherwise=1.0), build.signal("instant_share", otherwise=1.0)
    polarising = build.signal("polarising_voltage", otherwise=effective)
    build.measure("capacitance", instant * film.capacitance)
    charge = film.capacitance / left * polarising
    build.measure("current", build.signal("leakage_current", otherwise=0.0), stored=charge, share=left)
