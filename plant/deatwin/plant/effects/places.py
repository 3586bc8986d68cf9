"""Effects at further places: the same law applied to another signal of the plant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, ClassVar

from deatwin.plant.effects.base import Effect, Site
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.parameters import Parameter


class Elsewhere(Effect):
    """An effect at one of its further places."""

    first: ClassVar[type[Effect]]
    site: ClassVar[Site]

    def describe(self) -> tuple[Parameter, ...]:
        own = {p.name: p for p in self.first().describe()}
        if self.site.strength is not None:
            own[self.strength] = self.site.strength
        return tuple(replace(p, name=name, value=getattr(self, name)) for name, p in own.items())

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (self.first, self.placed_at, {f.name: getattr(self, f.name) for f in fields(self)})


@lru_cache(maxsize=256)
def placed(first: type[Effect], at: str) -> type[Effect]:
    """Return the class of the effect `first` at another place."""
    if at not in first.places:
        known = ", ".join(first.places) or "no other"
        raise RigError(f"the effect {first.name} has no place {at!r}{nearest(at, first.places)} (known: {known})")
    site = first.places[at]
    own: dict[str, Any] = {
        "first": first,
        "site": site,
        "placed_at": at,
        "places": MappingProxyType({}),
        "name": f"{first.name}_at_{at}",
        "family": site.family or first.family,
        "__module__": first.__module__,
        "__qualname__": f"{first.__qualname__} at {at}",
        **{name: getattr(site, name) for name in ("place", "signal", "order", "wording", "title")},
    }
    if site.strength is not None:
        own |= {first.strength: site.strength.value, "__annotations__": {first.strength: float}}
    return dataclass(frozen=True, kw_only=True)(type(first.__name__, (Elsewhere, first), own))


def everywhere(effects: Iterable[Effect]) -> Iterator[Effect]:
    """Return each effect, followed by its versions at further places."""
    for effect in effects:
        yield effect
        yield from (effect.placed(at) for at in effect.places)


def _made(first: type[Effect], at: str, values: Mapping[str, float]) -> Effect:
    return placed(first, at)(**values)
