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
    """Base of frozen dataclasses whose constructor makes their arrays read-only, also those in tuples."""

    def __post_init__(self) -> None:
        for value in vars(self).values():
            for array in value if isinstance(value, tuple) else (value,):
                if isinstance(array, np.ndarray):
                    array.setflags(write=False)
