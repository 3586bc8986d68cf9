"""JSON files that studies keep: read with one clear error, whatever they hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from deatwin.plant.documents import read_json
from deatwin.plant.errors import DataError, ModelError

__all__ = ["read_object"]


def read_object(path: Path, wanted: str = "an object") -> dict[str, Any]:
    """The object that a JSON file holds.

    Parameters
    ----------
    path : path
        The file.
    wanted : str
        What it must hold, for the error text.

    Returns
    -------
    dict
        Its numbers are finite.

    Raises
    ------
    DataError
        If the file is missing, no plain file, too large, not JSON, or holds something else than an object.
    """
    try:
        found = read_json(path)
    except ModelError as error:
        raise DataError(f"{error}; it must hold {wanted}") from None
    if not isinstance(found, dict):
        raise DataError(f"{path}: it must hold {wanted}")
    return found
