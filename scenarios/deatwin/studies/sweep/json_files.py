"""Read JSON files of studies, with one clear error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from deatwin.plant.documents import read_json
from deatwin.plant.errors import DataError, ModelError


def read_object(path: Path, wanted: str = "an object") -> dict[str, Any]:
    """Return the object in a JSON file."""
    try:
        found = read_json(path)
    except ModelError as error:
        raise DataError(f"{error}; it must hold {wanted}") from None
    if not isinstance(found, dict):
        raise DataError(f"{path}: it must hold {wanted}")
    return found
