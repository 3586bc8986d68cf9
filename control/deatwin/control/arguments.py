"""Check the types and values of arguments; a wrong one raises a clear error that names it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from inspect import signature
from math import isfinite
from typing import Any, ParamSpec, TypeVar

import numpy as np

from deatwin.control.errors import ControlError
from deatwin.ident.arguments import real_numbers
from deatwin.ident.narx.identifier import Identifier
from deatwin.plant.errors import ModelError

P = ParamSpec("P")
R = TypeVar("R")
Check = Callable[[Any, str], object]
"""Function that takes a value and its name, and raises ControlError if the value is of another kind."""


def taking(**checks: Check) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function so that its arguments are checked first; an argument equal to its default is not checked."""

    def decorate(taker: Callable[P, R]) -> Callable[P, R]:
        parameters = signature(taker)

        @wraps(taker)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                given = parameters.bind(*args, **kwargs).arguments
            except TypeError:
                return taker(*args, **kwargs)  # Python's own error names the function, too
            for name, value in given.items():
                if name in checks and value is not parameters.parameters[name].default:
                    checks[name](value, name)
            return taker(*args, **kwargs)

        return checked

    return decorate


def require_fields(owner: object, **checks: Check) -> None:
    """Check attributes of an object."""
    for name, check in checks.items():
        check(getattr(owner, name), name)


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
        raise ControlError(f"{name} must have one coefficient or more; got {_kind(value)}")


def coefficients(value: Any, name: str) -> None:
    """Raise an error unless a value is one list of finite numbers. Shapes: `value` (n,)."""
    numbers(value, name)
    if np.ndim(value) > 1 or np.size(value) == 0:
        raise ControlError(f"{name} must be a list of coefficients; got {_kind(np.asarray(value))}")
    if not np.isfinite(value).all():
        raise ControlError(f"{name} must be finite")


def number(value: Any, name: str) -> None:
    """Raise an error unless a value is one real number."""
    kinds = int | float | np.integer | np.floating | np.ndarray
    if not isinstance(value, kinds) or np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
        raise ControlError(f"{name} must be a number; got {_kind(value)}")


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
        raise ControlError(f"{name} must be a row of one or more numbers; got {_kind(value)}")
    if not np.isfinite(value).all():
        raise ControlError(f"{name} must be finite")


def pair(value: Any, name: str) -> None:
    """Raise an error unless a value consists of two finite numbers."""
    if isinstance(value, str | Mapping) or np.shape(_or_none(value)) != (2,):
        raise ControlError(f"{name} must be two numbers, the least and the largest; got {_kind(value)}")
    for end, one in zip(("first", "second"), value, strict=True):
        finite(one, f"the {end} of {name}")


def whole(least: int) -> Check:
    """Return a check that accepts only integers of at least a given size."""

    def check(value: Any, name: str) -> None:
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
            shown = value if isinstance(value, int | float | np.number) else _kind(value)
            raise ControlError(f"{name} must be an integer of at least {least}; got {shown}")

    return check


def instance(*kinds: type, hint: str = "") -> Check:
    """Return a check that accepts only objects of given classes."""
    wanted = " or ".join(_with_article(kind.__name__) for kind in kinds)

    def check(value: Any, name: str) -> None:
        if not isinstance(value, kinds):
            raise ControlError(f"{name} must be {wanted}{hint}; got {_kind(value)}")

    return check


def each(check: Check) -> Check:
    """Return a check that applies another check to every member of a sequence."""

    def check_all(value: Any, name: str) -> None:
        if not isinstance(value, list | tuple | np.ndarray):
            raise ControlError(f"{name} must be a list or a tuple; got {_kind(value)}")
        for place, member in enumerate(value):
            check(member, f"{name}[{place}]")

    return check_all


def generator(value: Any, name: str) -> None:
    """Raise an error unless a value is a source of random numbers."""
    instance(np.random.Generator, hint=", as numpy.random.default_rng(0)")(value, name)


def function(value: Any, name: str) -> None:
    """Raise an error unless a value can be called."""
    if not callable(value):
        raise ControlError(f"{name} must be a function; got {_kind(value)}")


def _or_none(value: Any) -> Any:
    """Return the value as an array, or None if numpy cannot make one of it."""
    try:
        np.shape(value)
    except ValueError:
        return None
    return value


def _kind(value: Any) -> str:
    """Describe the kind of a value in a word or two; the value itself may be too long for a message."""
    if value is None:
        return "None"
    if isinstance(value, str):
        return "text"
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, Identifier):
        return f"{_with_article(type(value).__name__)}, whose model_ is the fitted model"
    return _with_article(type(value).__name__)


def _with_article(name: str) -> str:
    return f"an {name}" if name[0] in "aeioAEIO" else f"a {name}"
