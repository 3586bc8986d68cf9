"""Read and write JSON documents with a schema: written atomically, read with one clear error."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from deatwin.plant.arguments import MALFORMED, instance
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import DeatwinError, ModelError
from deatwin.plant.files import write_text_atomic
from deatwin.plant.safe_read import DOCUMENT_BYTES, DOCUMENT_VALUES, clipped, read_regular
from deatwin.plant.schemacheck import shape_fault, shipped_schema

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
