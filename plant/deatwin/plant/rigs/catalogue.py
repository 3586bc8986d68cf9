"""Catalogue of all installed rigs: the project's own, and those of other packages by entry points."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.rigs.base import Rig

GROUP = "deatwin.rigs"
FOREIGN = EntryPoint("foreign", "deatwin.plant.foreign.rig:ForeignRig", GROUP)
"""Rig for models written elsewhere, of any kind; a rig file cannot name it."""


@lru_cache
def _point_named(name: str) -> type[Rig] | None:
    """Return the rig of the entry point with a name, without loading other entry points, which may be slow or broken."""
    points = [FOREIGN] if name == FOREIGN.name else entry_points(group=GROUP, name=name)
    kinds = [point.load() for point in points]
    return next((kind for kind in kinds if kind.kind == name), None)


@lru_cache(maxsize=1)
def _kinds() -> dict[str, type[Rig]]:
    kinds = [point.load() for point in entry_points(group=GROUP)]
    return {kind.kind: kind for kind in kinds}


def rig_kind(name: str) -> type[Rig]:
    """The class of a rig, by its name, such as "diaphragm"."""
    named = _point_named(name)
    if named is not None:
        return named
    try:
        return _kinds()[name]
    except KeyError:
        known = ", ".join(_kinds())
        raise RigError(
            f"there is no rig {name!r}{nearest(name, _kinds())} (known: {known}; "
            f"others come by the entry point {GROUP!r})"
        ) from None
