"""Collect the numerical constants of a package, for a seal."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

import numpy as np


def constants(packages: Iterable[str]) -> dict[str, Any]:
    """Collect every module constant that is a number or a group of numbers, by module and name."""
    found = {}
    for package in map(import_module, packages):
        modules = [package.__name__]
        modules += [m.name for m in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
        for module in modules:
            for name, value in vars(import_module(module)).items():
                plain = _numbers(value) if name.lstrip("_").isupper() else None
                if plain is not None:
                    found[f"{module}.{name}"] = plain
    return dict(sorted(found.items()))


def _numbers(value: Any) -> Any:
    """Return the value as plain data if it is made of numbers, else None."""
    if isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        inside = {str(k): _numbers(v) for k, v in value.items()}
        return None if None in inside.values() or not inside else inside
    if isinstance(value, (tuple, list)):
        several = [_numbers(v) for v in value]
        return None if None in several or not several else several
    return None
