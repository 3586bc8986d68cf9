"""Support of the sides of a film that moves along one direction."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any

from deatwin.plant.builder import Builder
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.film import AnyFilm
from deatwin.plant.limits import watch_limits
from deatwin.plant.rigs.film_actuator import watch_breakdown

Symbol = Any
Sides = Callable[[str, Symbol, float, Builder], tuple[Symbol, list[Symbol]]]


def _equal(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    return along, []


def _free(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    side = build.coordinate(name, scale=1.0)
    build.guess(side, across)
    return side, [side]


def _clamped(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    return build.constant(name, across), []


SIDES: Mapping[str, Sides] = MappingProxyType({"equal": _equal, "free": _free, "clamped": _clamped})
"""``SIDES[how](name, along, across, build)``: the stretch across a film that has the stretch `along` (a symbol)
along the motion and `across` at rest, and the coordinates that it takes."""
LIMITS: Mapping[str, Callable[[AnyFilm, Symbol, Builder], None]] = MappingProxyType(
    {"equal": watch_breakdown, "free": watch_breakdown, "clamped": watch_limits}
)
"""Limits to watch: a film with free sides has no tension to lose."""


def check_sides(sides: str, known: Collection[str]) -> None:
    """Refuse sides that a rig does not have."""
    if sides not in known:
        raise RigError(f"unknown sides {sides!r}{nearest(sides, known)} (known: {', '.join(known)})")
