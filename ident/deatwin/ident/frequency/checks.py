"""Checks of what is given to the functions of frequency: numbers, probabilities, and the order of a response."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import read_only
from deatwin.plant.errors import ModelError

__all__ = ["polynomial_model", "probability", "real_number", "real_numbers", "whole_number", "whole_order"]

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


def real_number(value: Any, name: str) -> float:
    """Return one real number.

    Parameters
    ----------
    value : float
        What was given; it may be infinite or NaN.
    name : str
        What it is, for the error.

    Raises
    ------
    ModelError
        If it is something else, as text or several numbers.
    """
    given = real_numbers(value, name)
    if given.ndim:
        raise ModelError(f"{name} must be one number; got an array of shape {given.shape}")
    return float(given)


def probability(level: Any, name: str = "level") -> float:
    """Return a probability that is neither 0 nor 1.

    Parameters
    ----------
    level : float
        What was given.
    name : str
        What it is, for the error.

    Raises
    ------
    ModelError
        If it is no number, or not between 0 and 1.
    """
    found = real_number(level, name)
    if not 0.0 < found < 1.0:
        raise ModelError(f"{name} = {level}; it must lie between 0 and 1")
    return found


def whole_number(value: Any, name: str, least: int = 1, most: int | None = None) -> int:
    """Return an integer.

    Parameters
    ----------
    value : int
        What was given.
    name : str
        What it is, for the error.
    least : int
        The smallest that is allowed.
    most : int, optional
        The largest that is allowed; any by default.

    Raises
    ------
    ModelError
        If it is not an integer, or not in the range.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        wanted = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ModelError(f"{name} = {value!r}; it must be an integer {wanted}")
    return int(value)


def polynomial_model(model: Any) -> NarxModel:
    """Return a model that is a NarxModel.

    Parameters
    ----------
    model : NarxModel
        What was given.

    Raises
    ------
    ModelError
        If it is something else, as a LinearModel.
    """
    if not isinstance(model, NarxModel):
        raise ModelError(f"a {type(model).__name__} is no NarxModel; frf computes the response of a linear model")
    return model


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
    return whole_number(order, "order", 1, highest)
