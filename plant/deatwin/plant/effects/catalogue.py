"""Catalogue of all installed effects: the project's own, and those of other packages by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any
from warnings import warn

from deatwin.plant.arguments import instance, taking
from deatwin.plant.effects.backlash import Backlash
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.dead_zone import DeadZone
from deatwin.plant.effects.dry_friction import DryFriction
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.places import placed
from deatwin.plant.effects.relaxation import Relaxation
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.safe_read import clipped

GROUP = "deatwin.effects"
MACHINES: tuple[type[Effect], ...] = (Backlash, DeadZone, DryFriction, Relaxation)
"""Effects of rigs without a film. A film actuator has creep instead of relaxation, and neither gears nor valves."""


@lru_cache(maxsize=1)
def _types() -> dict[str, type[Effect]]:
    types: dict[str, type[Effect]] = {}
    # deatwin's own effects come first, so that an effect of the same name from another package is left out.
    for point in sorted(entry_points(group=GROUP), key=lambda p: (p.name, not p.value.startswith("deatwin."))):
        try:
            kind = _loaded(point)
            if types.get(kind.name, kind) is not kind:
                raise RigError(f"{types[kind.name].__module__} already has an effect of this name")
        except Exception as error:  # another package may raise anything
            said = str(error) if isinstance(error, RigError) else f"{type(error).__name__}: {error}"
            warn(f"the effect {point.name} ({point.value}) is left out: {clipped(said, 300)}", stacklevel=2)
            continue
        types[kind.name] = kind
    return types


def _loaded(point: EntryPoint) -> type[Effect]:
    """Return the effect class of an entry point; raise `RigError` if a diagnosis cannot use it."""
    kind = point.load()
    if not (isinstance(kind, type) and issubclass(kind, Effect)):
        raise RigError("it is not a subclass of deatwin.plant.Effect")
    if missing := [
        name for name in ("name", "family", "place", "signal", "strength", "wording") if not hasattr(kind, name)
    ]:
        raise RigError(f"the class lacks its {', '.join(missing)}")
    if kind.name != point.name:
        raise RigError(f"the class calls itself {kind.name!r}; entry point and class need the same name")
    typical = kind()
    described = {parameter.name: parameter for parameter in typical.describe()}
    if described.keys() != {typical.strength, *typical.shapes}:
        raise RigError(
            f"it describes {', '.join(described) or 'nothing'}; it must describe each of its fields and its strength"
        )
    strength = described[typical.strength]
    if not strength.lower <= 0.0 <= strength.upper:
        raise RigError(f"the range of its strength {strength.name} lacks 0, where the effect is off")
    try:
        typical.wording.format(**dict.fromkeys(described, ""))
    except (KeyError, IndexError, ValueError) as error:
        raise RigError(f"its wording {typical.wording!r} has a placeholder that is no parameter: {error}") from None
    return kind


def catalogue() -> tuple[Effect, ...]:
    """Return all effects, including those of installed packages, at their typical strength and sorted by name."""
    return tuple(kind() for kind in _types().values())


def machine_catalogue() -> tuple[Effect, ...]:
    """Return the catalogue, in which the effects of machines replace others of the same names."""
    types = {**_types(), **{t.name: t for t in MACHINES}}
    return tuple(types[name]() for name in sorted(types))


@taking(name=instance(str, error=RigError))
def effect_named(name: str) -> Effect:
    """Return the effect with a given name, at its typical strength.

    Parameters
    ----------
    name : str
        Name, such as ``"creep"``, or ``"delay_at_reading"`` for an effect at a place other than its usual one
        (`Effect.places`).

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
    types |= {f"{kind.name}_at_{at}": placed(kind, at) for kind in types.values() for at in kind.places}
    try:
        return types[name]()
    except KeyError:
        known = ", ".join(sorted(types))
        raise RigError(f"there is no effect {name!r}{nearest(name, types)} (known: {known})") from None


def effect_from(entry: str | Mapping[str, Any]) -> Effect:
    """Return the effect of a model file's entry."""
    if isinstance(entry, str):
        return effect_named(entry)
    if entry.get("law") != "spectrum":
        return FreeForm.from_entry(entry)
    name = entry.get("name")
    if not isinstance(name, str):
        raise RigError("the entry of an effect with a spectrum needs the effect's name")
    wide = effect_named(name).broadened()
    if wide is None:
        raise RigError(f"effect {name} is not known with a spectrum; write its name alone")
    return wide
