"""Catalogue of all installed effects: the project's own, and those of others by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any

from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.errors import RigError, nearest

GROUP = "deatwin.effects"


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
    try:
        return _types()[name]()
    except KeyError:
        known = ", ".join(_types())
        raise RigError(f"there is no effect {name!r}{nearest(name, _types())} (known: {known})") from None


def effect_from(entry: str | Mapping[str, Any]) -> Effect:
    """Return the effect of a model file's entry."""
    return effect_named(entry) if isinstance(entry, str) else FreeForm.from_entry(entry)
