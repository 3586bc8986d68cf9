"""JSON documents with a schema: written as a whole, read with one clear error."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from deatwin.plant.errors import DeatwinError, ModelError
from deatwin.plant.files import write_text_atomic

__all__ = ["read_document", "write_document"]

Content = TypeVar("Content")


def write_document(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    """Write a document beside its target, then rename it.

    Parameters
    ----------
    path : str or path
        File to write; replaced as a whole.
    document : mapping
        Plain data; numbers must be finite.
    """
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    write_text_atomic(Path(path), text + "\n")


def read_document(
    path: str | os.PathLike[str], schema: str, build: Callable[[Mapping[str, Any]], Content]
) -> Content:
    """Read a document and make of it what it describes.

    Parameters
    ----------
    path : str or path
        File to read.
    schema : str
        The schema that the document must name, for example ``"deatwin/narx/1"``.
    build : callable
        Takes the document.

    Returns
    -------
    whatever `build` returns

    Raises
    ------
    ModelError
        If the file is missing, not JSON, of another schema, or malformed.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ModelError(f"{path}: there is no such file") from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    except RecursionError:
        raise ModelError(f"{path}: not a readable JSON file (lists in lists, too deep)") from None
    except ValueError as error:  # no UTF-8, or no JSON
        raise ModelError(f"{path}: not a readable JSON file ({error})") from error
    found = document.get("schema") if isinstance(document, dict) else None
    if found is None:
        raise ModelError(f"{path}: it names no schema; {schema!r} is needed")
    if found != schema:
        raise ModelError(f"{path}: schema is {found!r}; {schema!r} is needed")
    try:
        return build(document)
    except KeyError as error:
        raise ModelError(f"{path}: the key {error} is missing") from error
    except DeatwinError as error:
        raise ModelError(f"{path}: {error}") from error
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise ModelError(f"{path}: not a valid {schema} file: {error}") from error
