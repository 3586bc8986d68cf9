"""Check the types and values of arguments; a wrong one raises a clear error that names it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from deatwin.control.errors import ControlError
from deatwin.ident.arguments import real_numbers
from deatwin.plant.arguments import Check, kind_of
from deatwin.plant.arguments import each as each_of
from deatwin.plant.arguments import instance as of_class
from deatwin.plant.arguments import of_plain_data as of_plain_data
from deatwin.plant.arguments import require_fields as require_fields
from deatwin.plant.arguments import taking as taking
from deatwin.plant.errors import ModelError

instance, each = partial(of_class, error=ControlError), partial(each_of, error=ControlError)
"""The checks of `deatwin.plant.arguments` with the error of this package."""


def numbers(value: Any, name: str) -> None:
    """Raise an error unless a value is an array of real numbers."""
    try:
        real_numbers(value, name)
    except ModelError as error:
        raise ControlError(str(error)) from None


def polynomials(value: Any, name: str) -> None:
    """Raise an error unless a value is an array of real numbers, with one coefficient or more. Shapes: `value` (..., n)."""
    numbers(value, name)
    if np.size(value) == 0:
        raise ControlError(f"{name} must have one coefficient or more; got {kind_of(value)}")


def coefficients(value: Any, name: str) -> None:
    """Raise an error unless a value is one list of finite numbers. Shapes: `value` (n,)."""
    numbers(value, name)
    if np.ndim(value) > 1 or np.size(value) == 0:
        raise ControlError(f"{name} must be a list of coefficients; got {kind_of(np.asarray(value))}")
    if not np.isfinite(value).all():
        raise ControlError(f"{name} must be finite")


def number(value: Any, name: str) -> None:
    """Raise an error unless a value is one real number."""
    kinds = int | float | np.integer | np.floating | np.ndarray
    if not isinstance(value, kinds) or np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
        raise ControlError(f"{name} must be a number; got {kind_of(value)}")


def finite(value: Any, name: str) -> None:
    """Raise an error unless a value is one finite number."""
    number(value, name)
    if not isfinite(value):
        raise ControlError(f"{name} is {float(value):g}: it must be finite")


def positive(value: Any, name: str) -> None:
    """Raise an error unless a value is one finite number above 0."""
    number(value, name)
    if not (isfinite(value) and value > 0.0):
        raise ControlError(f"{name} is {float(value):g}: it must be positive and finite")


def not_negative(value: Any, name: str) -> None:
    """Raise an error unless a value is one finite number of 0 or more."""
    finite(value, name)
    if value < 0.0:
        raise ControlError(f"{name} is {float(value):g}: it must not be negative")


def row(value: Any, name: str) -> None:
    """Raise an error unless a value is one row of finite numbers. Shapes: `value` (n,)."""
    numbers(value, name)
    if np.ndim(value) != 1 or np.size(value) == 0:
        raise ControlError(f"{name} must be a row of one or more numbers; got {kind_of(value)}")
    if not np.isfinite(value).all():
        raise ControlError(f"{name} must be finite")


def pair(value: Any, name: str) -> None:
    """Raise an error unless a value consists of two finite numbers."""
    if isinstance(value, str | Mapping) or np.shape(_or_none(value)) != (2,):
        raise ControlError(f"{name} must be two numbers, the least and the largest; got {kind_of(value)}")
    for end, one in zip(("first", "second"), value, strict=True):
        finite(one, f"the {end} of {name}")


def whole(least: int) -> Check:
    """Return a check that accepts only integers of at least a given size."""

    def check(value: Any, name: str) -> None:
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
            shown = value if isinstance(value, int | float | np.number) else kind_of(value)
            raise ControlError(f"{name} must be an integer of at least {least}; got {shown}")

    return check


def generator(value: Any, name: str) -> None:
    """Raise an error unless a value is a source of random numbers."""
    instance(np.random.Generator, hint=", as numpy.random.default_rng(0)")(value, name)


def function(value: Any, name: str) -> None:
    """Raise an error unless a value can be called."""
    if not callable(value):
        raise ControlError(f"{name} must be a function; got {kind_of(value)}")


def _or_none(value: Any) -> Any:
    """Return the value as an array, or None if numpy cannot make one of it."""
    try:
        np.shape(value)
    except ValueError:
        return None
    return value
