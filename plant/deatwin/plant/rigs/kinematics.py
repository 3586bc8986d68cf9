"""Kinematics of a rig's film: points with stretches in terms of the rig's coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from deatwin.plant.effects.base import Place
from deatwin.plant.film import AnyFilm, FilmPoint

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


Symbol = Any


@dataclass(frozen=True, kw_only=True, eq=False)
class Kinematics:
    """A film in terms of coordinates."""

    points: Sequence[FilmPoint]  # Points at which stretches are taken, in terms of the coordinates
    coordinates: Sequence[Symbol]  # The algebraic ones, each with a balance to be given
    film: Callable[..., AnyFilm]


class BallInFilm(Protocol):
    """A rig with a ball at the centre of a film in a ring, as `Diaphragm` has it; lengths in m."""

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
    """Share of the electrode's area that is there still."""
    return build.share("electrode_share", build.place(Place.FILM, "electrode_share", 1.0))
