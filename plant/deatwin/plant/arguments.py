"""Check the types and values of arguments; a wrong one raises a clear error that names it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from inspect import signature
from os import PathLike
from typing import Any, ParamSpec, TypeVar

import numpy as np

from deatwin.plant.errors import DataError, DeatwinError, ModelError
from deatwin.plant.safe_read import clipped

P = ParamSpec("P")
R = TypeVar("R")
Check = Callable[[Any, str], object]
"""Function that takes a value and its name, and raises an error if the value is of another kind."""


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


def as_annotated(sources: Mapping[str, str]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator like `taking` by annotations; `sources` says which call returns objects of each class."""

    def decorate(taker: Callable[P, R]) -> Callable[P, R]:
        annotations = {name: str(one.annotation) for name, one in signature(taker).parameters.items()}
        checks = {name: _annotated(text.removesuffix(" | None"), sources) for name, text in annotations.items()}
        return taking(**{name: check for name, check in checks.items() if check is not None})(taker)

    return decorate


def of_plain_data(error: type[DeatwinError] = ModelError) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a class method that makes an object of plain data; other data raise one error that names the fault."""

    def decorate(make: Callable[P, R]) -> Callable[P, R]:
        @wraps(make)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            kind, data = signature(make).bind(*args, **kwargs).arguments.values()
            instance(Mapping, hint=f", as {kind.__name__}.to_dict returns it", error=error)(data, "data")
            try:
                return make(*args, **kwargs)
            except DeatwinError:
                raise
            except MALFORMED as fault:
                advice = f"give data as {kind.__name__}.to_dict returns them"
                raise error(f"malformed {kind.__name__}: {_misfit(fault)}; {advice}") from fault

        return checked

    return decorate


MALFORMED = (TypeError, ValueError, AttributeError, LookupError, ArithmeticError, MemoryError, RecursionError)
"""Errors that data of a wrong shape may raise: a missing key, a value of the wrong kind, too large or nested too deeply."""


def _misfit(fault: BaseException) -> str:
    """Say in words why data do not fit an object."""
    said = clipped(fault, 200)
    if isinstance(fault, KeyError):
        return f"the key {said} is missing"
    if unknown := re.search(r"unexpected keyword argument ('\w+')", said):
        return f"the key {unknown[1]} is unknown"
    if missing := re.search(r"missing \d+ required (?:[\w-]+ )?arguments?: (.*)", said):
        return f"{missing[1]} {'are' if ' and ' in missing[1] else 'is'} missing"
    return said


_PACKAGES = frozenset({"deatwin", "numpy"})
"""Packages whose classes the annotations name."""


def _annotated(annotation: str, sources: Mapping[str, str]) -> Check | None:
    """Return the check of a class or of an iterable of its objects; None if nothing is known of the annotation."""
    kind = re.findall(r"\w+", annotation)[-1]  # by its name, because a module may import a class for type checkers only

    def check(value: Any, name: str) -> None:
        known = (one for one in value.__class__.__mro__ if one.__module__.partition(".")[0] in _PACKAGES)
        if kind not in (one.__name__ for one in known):
            raise ModelError(f"{name} must be {_with_article(kind)}; got {kind_of(value)}: {sources[kind]}")

    def check_many(value: Any, name: str) -> None:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise ModelError(f"{name} must be a list of {kind} objects; got {kind_of(value)}: {sources[kind]}")
        # An iterator can be read only once, and members of members are not looked at.
        for place, member in enumerate(value if isinstance(value, Sequence) and flat else ()):
            check(member, f"{name}[{place}]")

    if kind not in sources:
        return None
    flat = annotation.count("[") == 1
    if re.fullmatch(r"Sequence\[.+\]", annotation):
        return check_many
    return check if re.fullmatch(r"[\w.]+", annotation) else None


def require_fields(owner: object, **checks: Check) -> None:
    """Check attributes of an object."""
    for name, check in checks.items():
        check(getattr(owner, name), name)


def instance(*kinds: type, hint: str = "", error: type[DeatwinError] = ModelError) -> Check:
    """Return a check that accepts only objects of given classes."""
    wanted = " or ".join(_with_article(kind.__name__) for kind in kinds)

    def check(value: Any, name: str) -> None:
        if not isinstance(value, kinds):
            raise error(f"{name} must be {wanted}{hint}; got {kind_of(value)}")

    return check


def each(check: Check, error: type[DeatwinError] = ModelError) -> Check:
    """Return a check that applies another check to every member of a sequence."""

    def check_all(value: Any, name: str) -> None:
        if not isinstance(value, list | tuple | np.ndarray):
            raise error(f"{name} must be a list or a tuple; got {kind_of(value)}")
        for place, member in enumerate(value):
            check(member, f"{name}[{place}]")

    return check_all


def truth(value: Any, name: str) -> None:
    """Raise an error unless a value is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ModelError(f"{name} must be True or False; got {kind_of(value)}")


def file_name(value: Any, name: str) -> None:
    """Raise an error unless a value is the path of a file."""
    instance(str, PathLike, error=DataError)(value, name)


def kind_of(value: Any) -> str:
    """Describe the kind of a value in a word or two; the value itself may be too long for a message."""
    if value is None:
        return "None"
    if isinstance(value, str):
        return "text"
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a {type(value).__name__} of {len(value)}"
    if callable(getattr(value, "fit", None)):
        return f"{_with_article(type(value).__name__)}, whose model_ is the fitted model"
    return _with_article(type(value).__name__)


def _with_article(name: str) -> str:
    return f"an {name}" if name[0] in "aeioAEIO" else f"a {name}"
