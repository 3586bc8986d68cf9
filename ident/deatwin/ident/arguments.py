"""Check the arguments of functions and estimators: numbers, probabilities, integers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.errors import ModelError, nearest

_OTHERS = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "text"}


def read_only(values: ArrayLike, kind: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy."""
    array = np.array(values, dtype=kind)
    array.setflags(write=False)
    return array


def keep_read_only(owner: object, *names: str, kind: Any = np.float64) -> None:
    """Replace attributes of a frozen object by read-only copies."""
    for name in names:
        object.__setattr__(owner, name, read_only(getattr(owner, name), kind))


def real_numbers(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return real numbers as a read-only array."""
    try:
        given = np.asarray(values)
    except ValueError:
        raise ModelError(f"{name} must be an array of real numbers; its rows differ in length") from None
    if np.ma.is_masked(values):
        raise ModelError(f"{name} has masked values: leave them out")
    if given.dtype.kind not in "iuf":
        raise ModelError(f"{name} must be real numbers; got {_OTHERS.get(given.dtype.kind, 'other objects')}")
    return read_only(given)


def real_number(value: Any, name: str) -> float:
    """Return a value as one real number, after a check."""
    given = real_numbers(value, name)
    if given.ndim:
        raise ModelError(f"{name} must be one number; got an array of shape {given.shape}")
    return float(given)


def probability(level: Any, name: str = "level") -> float:
    """Return a probability, after a check that it lies between 0 and 1."""
    found = real_number(level, name)
    if not 0.0 < found < 1.0:
        raise ModelError(f"{name} = {level}; it must lie between 0 and 1")
    return found


def whole_number(value: Any, name: str, least: int = 1, most: int | None = None) -> int:
    """Return an integer, after a check."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        wanted = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ModelError(f"{name} = {value!r}; it must be an integer {wanted}")
    return int(value)


def one_of(value: Any, name: str, known: Sequence[str]) -> None:
    """Raise an error unless a value is one of the known choices."""
    if value not in known:
        raise ModelError(f"{name} = {value!r}{nearest(str(value), known)}; known are {', '.join(known)}")


def positive(value: Any, name: str) -> float:
    """Return a number, after a check that it is above 0 and finite."""
    found = real_number(value, name)
    if not 0.0 < found < np.inf:
        raise ModelError(f"{name} = {value}; it must be positive and finite")
    return found
