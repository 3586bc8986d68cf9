"""Results that nobody can change, also in copies."""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np


class Rebuilt:
    """Base of dataclasses whose copies, also those in other processes, come from the constructor and keep its rules."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Mapping proxies cannot be pickled, and cached values need not be.
        state = {item.name: getattr(self, item.name) for item in fields(self) if item.init}  # type: ignore[arg-type]
        plain = {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in state.items()}
        return partial(type(self), **plain), ()


class Frozen(Rebuilt):
    """Base of frozen dataclasses whose constructor makes their arrays read-only, also those in tuples and mappings."""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, _frozen(value))


def _frozen(value: Any) -> Any:
    """Return a value whose arrays nobody can change; of a mapping, a copy that no caller holds."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif type(value) is tuple:
        return tuple(map(_frozen, value))
    elif isinstance(value, dict):
        return {key: _frozen(held) for key, held in value.items()}  # no proxy, which JSON and `asdict` refuse
    return value
