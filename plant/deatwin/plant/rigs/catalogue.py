"""Catalogue of all installed rigs: the project's own, and those of other packages by entry points."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from warnings import warn

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.rigs.base import Rig
from deatwin.plant.safe_read import clipped

GROUP = "deatwin.rigs"
FOREIGN = EntryPoint("foreign", "deatwin.plant.foreign.rig:ForeignRig", GROUP)
"""Rig for models written elsewhere, of any kind; a rig file cannot name it."""


@lru_cache
def _point_named(name: str) -> type[Rig] | None:
    """Return the rig of the entry point with a name, without loading other entry points, which may be slow or broken."""
    points = [FOREIGN] if name == FOREIGN.name else entry_points(group=GROUP, name=name)
    kinds = [_loaded(point) for point in points]
    return next((kind for kind in kinds if kind.kind == name), None)


@lru_cache(maxsize=1)
def _kinds() -> dict[str, type[Rig]]:
    kinds: dict[str, type[Rig]] = {}
    for point in entry_points(group=GROUP):
        try:
            kind = _loaded(point)
        except RigError as error:
            warn(f"{error}; it is left out", stacklevel=2)
        else:
            kinds[kind.kind] = kind
    return kinds


def _loaded(point: EntryPoint) -> type[Rig]:
    """Load a rig; RigError if this fails, because another package may raise anything."""
    try:
        kind = point.load()
        if not (isinstance(kind, type) and issubclass(kind, Rig)):
            raise TypeError("it is not a subclass of deatwin.plant.Rig")
    except Exception as error:
        said = clipped(f"{type(error).__name__}: {error}", 300)
        raise RigError(f"the rig {point.name} ({point.value}) cannot be used: {said}") from error
    return kind


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
