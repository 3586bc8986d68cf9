"""Checks of what is given to the functions of frequency: numbers, and the order of a response."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.narx.operating import read_only
from deatwin.plant.errors import ModelError

__all__ = ["real_numbers", "whole_order"]

_OTHERS = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "text"}


def real_numbers(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return real numbers as a read-only array.

    Parameters
    ----------
    values : array_like
        Any shape.
    name : str
        What they are, for the error.

    Raises
    ------
    ModelError
        If they are something else, as complex numbers or text.
    """
    try:
        given = np.asarray(values)
    except ValueError:
        raise ModelError(f"{name} must be an array of real numbers; its rows differ in length") from None
    if given.dtype.kind not in "iuf":
        raise ModelError(f"{name} must be real numbers; got {_OTHERS.get(given.dtype.kind, 'other objects')}")
    return read_only(given)


def whole_order(order: Any, highest: int | None = None) -> int:
    """Return the order of a response.

    Parameters
    ----------
    order : int
        What was given.
    highest : int, optional
        The largest that is allowed; any by default.

    Raises
    ------
    ModelError
        If it is not an integer, or not in the range.
    """
    is_whole = isinstance(order, int | np.integer) and not isinstance(order, bool)
    if not is_whole or order < 1 or (highest is not None and order > highest):
        wanted = "of at least 1" if highest is None else f"from 1 to {highest}"
        raise ModelError(f"order = {order!r}; it must be an integer {wanted}")
    return int(order)
