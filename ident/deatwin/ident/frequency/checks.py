"""Check arguments of the functions in `deatwin.ident.frequency`: numbers, probabilities, the order of a response."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.narx.identifier import Identifier
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import read_only
from deatwin.plant.errors import ModelError

_OTHERS = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "text"}


def real_numbers(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return real numbers as a read-only array."""
    try:
        given = np.asarray(values)
    except ValueError:
        raise ModelError(f"{name} must be an array of real numbers; its rows differ in length") from None
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


def narx_model(model: Any) -> NarxModel:
    """Return a model, after a check that it is a NarxModel."""
    if not isinstance(model, NarxModel):
        instead = (
            "its model_ may be" if isinstance(model, Identifier) else "frf computes the response of a linear model"
        )
        raise ModelError(f"a {type(model).__name__} is not a NarxModel; {instead}")
    return model


def polynomial_model(model: Any) -> NarxModel:
    """Return a NarxModel, after a check that its terms are polynomial; other functions have infinitely many orders."""
    if narx_model(model).table.functions:
        raise ModelError(
            f"frequency analysis needs a polynomial model, but this model contains {model.table.functions[0]}: identify it without "
            "functions, or compute its response with best_linear_approximation from a simulation with a multisine"
        )
    checked: NarxModel = model
    return checked


def whole_order(order: Any, highest: int | None = None) -> int:
    """Return the order of a response, after a check."""
    return whole_number(order, "order", 1, highest)
