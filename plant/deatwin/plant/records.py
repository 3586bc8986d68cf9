"""Convert typed records to and from plain data for files, following the fields of their classes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite
from types import NoneType, UnionType
from typing import Any, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

Json: TypeAlias = str | int | float | bool | Sequence[Any] | Mapping[str, Any] | None
"""Free JSON data, such as the fields of a rig in which two readings of its file differ."""
_KEY, _OPTIONAL, _INTERNAL, _UNBOUNDED = "key", "optional", "internal", "unbounded"
_Record = TypeVar("_Record")
OPTIONAL = {_OPTIONAL: True}  # Metadata of a field that a file omits if it is None
INTERNAL = {_INTERNAL: True}  # Metadata of a field that is never written to a file
UNBOUNDED = {_UNBOUNDED: True}  # Metadata of a number that may be infinite, which is read unchecked


def key(name: str) -> dict[str, str]:
    """Make metadata of a field with another name in the file, for instance because Python reserves it."""
    return {_KEY: name}


def plain(value: Any) -> Any:
    """Return a record as plain data, fields in order."""
    if is_dataclass(value):
        held = ((each, getattr(value, each.name)) for each in fields(value) if _INTERNAL not in each.metadata)
        return {_name(each): plain(one) for each, one in held if one is not None or _OPTIONAL not in each.metadata}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value


def finite(data: Any) -> Any:
    """Return plain data with None in place of numbers that JSON does not have."""
    if isinstance(data, Mapping):
        return {key: finite(one) for key, one in data.items()}
    if isinstance(data, (tuple, list)):
        return [finite(one) for one in data]
    return None if isinstance(data, float) and not isfinite(data) else data


def read(record: type[_Record], data: Any) -> _Record:
    """Make a record from its plain data; KeyError for a missing key, TypeError or ValueError for a wrong value."""
    if not isinstance(data, Mapping):
        raise TypeError(f"{record.__name__} is not a mapping: {data!r:.80}")
    hints, found = _hints(record), {}
    for each in fields(record):  # type: ignore[arg-type]
        name = _name(each)
        if _INTERNAL in each.metadata:
            continue
        if name in data:
            found[each.name] = data[name] if _UNBOUNDED in each.metadata else _value(hints[each.name], data[name])
        elif each.default is MISSING and each.default_factory is MISSING:
            raise KeyError(name)
    return record(**found)


_hints: Callable[[Any], dict[str, Any]] = cache(get_type_hints)


def _name(each: Field[Any]) -> str:
    return str(each.metadata.get(_KEY, each.name))


def _value(hint: Any, value: Any) -> Any:
    """Convert a plain value to its type."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint == Json:
        return value
    if origin in (Union, UnionType):
        absent = value is None or (isinstance(value, float) and not isfinite(value))  # a file holds null for both
        return None if absent else _value(next(one for one in arguments if one is not NoneType), value)
    if origin is np.ndarray:
        return np.array(_of(Sequence, value), dtype=get_args(arguments[1])[0])
    if origin is tuple:
        return tuple(_value(arguments[0], one) for one in _of(Sequence, value))
    if origin is not None:  # a mapping
        return {key: _value(arguments[1], one) for key, one in _of(Mapping, value).items()}
    if is_dataclass(hint):
        return read(hint, value)  # type: ignore[arg-type]
    if issubclass(hint, Enum):
        return hint(value)
    if hint is float and not isfinite(_of((int, float), value)):
        raise ValueError(f"{value} is not a finite number")
    return _of((int, float) if hint is float else hint, value)


def _of(kind: Any, value: Any) -> Any:
    """Return the value if it has a given kind; a text does not count as a list, nor a truth value as a number."""
    wrong = isinstance(value, bool) if kind is not bool and kind is not Mapping else False
    if wrong or (kind is Sequence and isinstance(value, str)) or not isinstance(value, kind):
        raise TypeError(f"{value!r:.80} is no {getattr(kind, '__name__', 'number')}")
    return value
