"""Read and write JSON documents with a schema: written atomically, read with one clear error."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from deatwin.plant.arguments import MALFORMED, instance
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import DeatwinError, ModelError
from deatwin.plant.files import write_text_atomic
from deatwin.plant.safe_read import DOCUMENT_BYTES, DOCUMENT_VALUES, clipped, read_regular

# A number that may be too large for a float; only files with one are read by the slower parser that checks each number.
_PERHAPS_HUGE = re.compile(rb"[0-9.][eE]\+?[0-9]{3}|[0-9]{309}")

Content = TypeVar("Content")
_require_path = instance(str, os.PathLike)


def write_document(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    """Write a document to a temporary file, then rename it."""
    _require_path(path, "path")
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    write_text_atomic(Path(path), text + "\n")


def read_document(path: str | os.PathLike[str], schema: str, build: Callable[[Mapping[str, Any]], Content]) -> Content:
    """Read a document, and return the object that it describes."""
    document = read_json(path)
    found = document.get("schema") if isinstance(document, dict) else None
    if found is None:
        raise ModelError(
            f"{path}: the file names no schema, so deatwin did not write it; a file with the schema {schema!r}{_in_words(schema)} is needed"
        )
    if found != schema:
        shown = f"{clipped(found)!r}{_in_words(found)}" if isinstance(found, str) else "no text"
        raise ModelError(f"{path}: its schema is {shown}, but {schema!r}{_in_words(schema)} is needed")
    try:
        content = build(document)
    except KeyError as error:
        raise ModelError(f"{path}: the key {clipped(error)} is missing") from error
    except DeatwinError as error:
        inner = isinstance(error.__cause__, MALFORMED) and not isinstance(error.__cause__, KeyError)
        fault = shape_fault(document, schema) if inner else ""
        raise ModelError(f"{path}: {fault or clipped(error, 1000)}") from error
    except MALFORMED as error:
        fault = shape_fault(document, schema) or clipped(error, 200)
        raise ModelError(f"{path}: not a valid {schema} file: {fault}") from error
    if fault := shape_fault(document, schema):  # `build` may accept a wrong shape, which would fail later
        raise ModelError(f"{path}: not a valid {schema} file: {fault}")
    return content


def _in_words(schema: str) -> str:
    """Describe the content of a kind of document in brackets; empty if no package ships it."""
    shipped = shipped_schema(schema) if re.fullmatch(r"deatwin/[a-z-]+/[0-9]+", schema) else None
    return "" if shipped is None else f" ({shipped['title'][0].lower()}{shipped['title'][1:]})"


class Saved(Rebuilt):
    """Base of results with a file; the class names its `schema` and the conversions to and from plain data."""

    _file: ClassVar[tuple[str, Callable[[Any], Mapping[str, Any]], Callable[[Any], Mapping[str, Any]]]]

    def __init_subclass__(
        cls,
        *,
        schema: str = "",
        document: Callable[[Any], Mapping[str, Any]] = vars,
        fields: Callable[[Any], Mapping[str, Any]] = dict,
        **more: Any,
    ) -> None:
        """Take schema and conversions from the class's arguments; without them, use those of the parent."""
        super().__init_subclass__(**more)
        if schema:
            cls._file = (schema, document, fields)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a JSON file at `path`, first under a temporary name."""
        _, document, _ = self._file
        write_document(path, document(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file that `save` wrote at `path`; ModelError if the file is missing or malformed."""
        schema, _, fields = cls._file
        return read_document(path, schema, lambda document: cls(**fields(document)))


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read any JSON file of a user."""
    _require_path(path, "path")
    try:
        content = read_regular(path, DOCUMENT_BYTES, lambda fault: ModelError(f"{path}: {fault}"))
    except FileNotFoundError:
        raise ModelError(f"{path}: there is no such file") from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    count = sum(map(content.count, (b",", b"[", b"{")))
    if count > DOCUMENT_VALUES:
        raise ModelError(f"{path}: it holds {count} numbers, texts and lists; at most {DOCUMENT_VALUES} can be read")
    huge = _PERHAPS_HUGE.search(content)
    real, whole = (_finite, _whole) if huge else (None, None)
    try:
        return json.loads(content.decode("utf-8-sig"), parse_float=real, parse_int=whole, parse_constant=_finite)
    except RecursionError:
        raise ModelError(f"{path}: not a readable JSON file (lists are nested too deeply)") from None
    except ValueError as error:  # not UTF-8, or not JSON
        raise ModelError(f"{path}: not a readable JSON file ({clipped(error, 200)})") from error


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{clipped(text, 20)} is not a finite number")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


_TYPES: Mapping[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
}
_WORDS = {
    "object": "an object",
    "array": "a list",
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "a truth value",
    "null": "null",
}
_BOUNDS = (
    ("minimum", "at least", lambda value, bound: value >= bound),
    ("exclusiveMinimum", "above", lambda value, bound: value > bound),
    ("maximum", "at most", lambda value, bound: value <= bound),
    ("exclusiveMaximum", "below", lambda value, bound: value < bound),
)


@cache
def shipped_schema(name: str) -> dict[str, Any] | None:
    """Return the JSON Schema of a kind of document that a package of deatwin ships."""
    import deatwin

    kind = name.split("/")[1]
    for root in deatwin.__path__:  # the source roots of the namespace package
        for file in sorted(Path(root).glob(f"*/schemas/{kind}.schema.json")):
            schema: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            if schema["$id"] == name:
                return schema
    return None


def shape_fault(document: Mapping[str, Any], name: str) -> str:
    """Describe the first fault in the values of a document; empty if there is none."""
    schema = shipped_schema(name)
    return "" if schema is None else next(_faults(document, schema, schema, ""), "")


def _faults(value: Any, schema: Mapping[str, Any], root: Mapping[str, Any], place: str) -> Iterator[str]:
    """Yield the faults of a value and of its parts."""
    if "$ref" in schema:
        yield from _faults(value, _referred(schema["$ref"], root), root, place)
    types = schema.get("type", ())
    types = (types,) if isinstance(types, str) else types
    if types and not any(_is(value, kind) for kind in types):
        yield f"{place}: {_shown(value)} is {_kind(value)}; it must be {' or '.join(_WORDS[t] for t in types)}"
        return
    yield from _choices(value, schema, place)
    for some in ("anyOf", "oneOf"):
        if some in schema and all(any(_faults(value, branch, root, place)) for branch in schema[some]):
            yield f"{place}: {_shown(value)} is of none of the kinds that the schema allows"
    for branch in schema.get("allOf", ()):
        yield from _faults(value, branch, root, place)
    if isinstance(value, dict):
        yield from _of_object(value, schema, root, place)
    elif isinstance(value, list):
        yield from _of_list(value, schema, root, place)
    elif isinstance(value, str):
        yield from _of_text(value, schema, place)
    elif _is(value, "number"):
        for key, words, holds in _BOUNDS:
            if key in schema and not holds(value, schema[key]):
                yield f"{place}: {_shown(value)} is out of range; it must be {words} {schema[key]:g}"


def _choices(value: Any, schema: Mapping[str, Any], place: str) -> Iterator[str]:
    allowed = [schema["const"]] if "const" in schema else schema.get("enum")
    same = [one for one in allowed or () if value == one and isinstance(value, bool) is isinstance(one, bool)]
    if allowed is not None and not same:
        yield f"{place}: {_shown(value)} is not known; it must be {' or '.join(map(_shown, allowed))}"


def _of_object(value: dict[str, Any], schema: Mapping[str, Any], root: Mapping[str, Any], place: str) -> Iterator[str]:
    known, further = schema.get("properties", {}), schema.get("additionalProperties")
    for key in schema.get("required", ()) if place else ():
        if key not in value:
            yield f'{place}: the key "{key}" is missing'
    for key, item in value.items():
        inner = f"{place}.{clipped(key, 40)}" if place else clipped(key, 40)
        if key in known:
            yield from _faults(item, known[key], root, inner)
        elif isinstance(further, dict):
            yield from _faults(item, further, root, inner)


def _of_list(value: list[Any], schema: Mapping[str, Any], root: Mapping[str, Any], place: str) -> Iterator[str]:
    fewest, most = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    if not fewest <= len(value) <= most:
        yield f"{place}: the list has {len(value)} entries; it must have {_between(fewest, most)}"
    first = schema.get("prefixItems", ())
    for k, (item, entry) in enumerate(zip(value, first, strict=False)):
        yield from _faults(item, entry, root, f"{place}[{k}]")
    if "items" not in schema:
        return
    items = schema["items"]
    if items == {"type": "number"} and all(type(item) is float or type(item) is int for item in value):
        return  # a series of numbers may be long, and needs no further check
    for k, item in enumerate(value[len(first) :], len(first)):
        yield from _faults(item, items, root, f"{place}[{k}]")


def _of_text(value: str, schema: Mapping[str, Any], place: str) -> Iterator[str]:
    if len(value) < schema.get("minLength", 0):
        yield f"{place}: the text is empty"
    if "pattern" in schema and not re.search(schema["pattern"], value):
        yield f"{place}: {_shown(value)} is not as the schema has it, {schema['pattern']}"


def _is(value: Any, kind: str) -> bool:
    if isinstance(value, bool):
        return kind == "boolean"
    if kind == "integer" and isinstance(value, float):
        return value.is_integer()
    return isinstance(value, _TYPES[kind])


def _kind(value: Any) -> str:
    return next(words for kind, words in _WORDS.items() if _is(value, kind) and kind != "integer")


def _shown(value: Any) -> str:
    """Write a value as in the file; for lists and objects, only their type."""
    if isinstance(value, dict):
        return "{…}"
    if isinstance(value, list):
        return "[…]"
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 300:
        return "a number of more than 90 digits"  # Python refuses to write thousands of digits
    return f'"{clipped(value, 40)}"' if isinstance(value, str) else json.dumps(value)


def _between(fewest: int, most: float) -> str:
    if fewest == most:
        return f"{fewest}"
    return f"at least {fewest}" if most == math.inf else f"{fewest} to {most}"


def _referred(reference: str, root: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = root
    for key in reference.removeprefix("#/").split("/"):
        found = found[key]
    return found
