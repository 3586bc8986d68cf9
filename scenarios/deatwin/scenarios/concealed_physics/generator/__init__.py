"""Generator of concealed cases: it shares no code and no parameter with the effects of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType, ModuleType

from deatwin.scenarios.concealed_physics.generator import electrical, film, mechanical, outside, sensor
from deatwin.scenarios.concealed_physics.generator.mechanism import Mechanism


def _kinds(module: ModuleType) -> list[type[Mechanism]]:
    """Return the mechanisms defined in a module, by the names of their classes."""
    of_module = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Mechanism)]
    return sorted((k for k in of_module if k.__module__ == module.__name__), key=lambda kind: kind.__name__)


MECHANISMS: Mapping[str, type[Mechanism]] = MappingProxyType(
    {kind.name: kind for module in (film, electrical, mechanical, sensor, outside) for kind in _kinds(module)}
)
