"""Catalogue of all installed effects: the project's own, and those of others by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any

from deatwin.plant.effects.backlash import Backlash
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.dead_zone import DeadZone
from deatwin.plant.effects.dry_friction import DryFriction
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.relaxation import Relaxation
from deatwin.plant.errors import RigError, nearest

GROUP = "deatwin.effects"
MACHINES: tuple[type[Effect], ...] = (Backlash, DeadZone, DryFriction, Relaxation)
"""What rigs lack that are no film actuators: a film has creep for relaxation, and neither gears nor valves."""


@lru_cache(maxsize=1)
def _types() -> dict[str, type[Effect]]:
    types = [point.load() for point in entry_points(group=GROUP)]
    return {t.name: t for t in sorted(types, key=lambda t: t.name)}


def catalogue() -> tuple[Effect, ...]:
    """Return every known effect at its typical strength, sorted by name.

    Returns
    -------
    tuple of Effect
    """
    return tuple(kind() for kind in _types().values())


def machine_catalogue() -> tuple[Effect, ...]:
    """The effects of the catalogue and those of machines, which replace others of their names."""
    types = {**_types(), **{t.name: t for t in MACHINES}}
    return tuple(types[name]() for name in sorted(types))


def effect_named(name: str) -> Effect:
    """Return an effect by its canonical name, at its typical strength.

    Parameters
    ----------
    name : str
        Canonical name, for example ``"creep"``.

    Returns
    -------
    Effect

    Raises
    ------
    RigError
        If no effect has this name.

    Examples
    --------
    >>> effect_named("creep").time
    60.0
    """
    types = {**{t.name: t for t in MACHINES}, **_types()}
    try:
        return types[name]()
    except KeyError:
        known = ", ".join(sorted(types))
        raise RigError(f"there is no effect {name!r}{nearest(name, types)} (known: {known})") from None


def effect_from(entry: str | Mapping[str, Any]) -> Effect:
    """Return the effect of a model file's entry."""
    return effect_named(entry) if isinstance(entry, str) else FreeForm.from_entry(entry)
