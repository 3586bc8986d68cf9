"""Concealed mechanisms: none shares code or parameters with an effect of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType, ModuleType

from deatwin.plant.errors import RigError, nearest
from deatwin.scenarios.concealed_physics.mechanisms import electrical, environment, film, mechanical, outside, sensor
from deatwin.scenarios.concealed_physics.mechanisms.base import (
    Drive,
    Mechanism,
    PlantMechanism,
    Reading,
    Setting,
    log_uniform,
)

__all__ = ["MECHANISMS", "Drive", "Mechanism", "PlantMechanism", "Reading", "Setting", "log_uniform", "mechanism_named"]

_MODULES = (film, electrical, mechanical, sensor, environment, outside)


def _kinds(module: ModuleType) -> list[type[Mechanism]]:
    """Mechanisms that a module defines, by the names of their classes: the order decides on what a seed draws."""
    of_module = [
        kind for kind in vars(module).values() if isinstance(kind, type) and kind.__module__ == module.__name__
    ]
    return sorted((kind for kind in of_module if issubclass(kind, Mechanism)), key=lambda kind: kind.__name__)


MECHANISMS: Mapping[str, type[Mechanism]] = MappingProxyType(
    {kind.name: kind for module in _MODULES for kind in _kinds(module)}
)
"""All of them by name."""


def mechanism_named(name: str) -> type[Mechanism]:
    """The kind of mechanism of a name."""
    try:
        return MECHANISMS[name]
    except KeyError:
        raise RigError(f"there is no concealed mechanism {name!r}{nearest(name, MECHANISMS)}") from None
