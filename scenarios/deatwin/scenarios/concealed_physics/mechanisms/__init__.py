"""Concealed mechanisms: none shares code or parameters with an effect of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

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
MECHANISMS: Mapping[str, type[Mechanism]] = MappingProxyType(
    {kind.name: kind for module in _MODULES for kind in (getattr(module, name) for name in module.__all__)}
)
"""All of them by name."""


def mechanism_named(name: str) -> type[Mechanism]:
    """The kind of mechanism of a name.

    Parameters
    ----------
    name : str
        For example ``"bristle_friction"``.

    Returns
    -------
    type of Mechanism

    Raises
    ------
    RigError
        If there is none.
    """
    try:
        return MECHANISMS[name]
    except KeyError:
        raise RigError(f"there is no concealed mechanism {name!r}{nearest(name, MECHANISMS)}") from None
