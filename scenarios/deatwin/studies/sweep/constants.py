"""Collect the numbers that decide a verdict, for a seal."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")  # Packages whose numbers decide a verdict


def thresholds() -> dict[str, Any]:
    """Collect the constants of the deciding packages that are numbers or groups of numbers, by module and name."""
    found = {}
    for package in map(import_module, DECIDING):
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
