"""Results as xarray datasets, which NetCDF files hold: one place for units, complex numbers, tables and documents."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.files.formats.optional import require

if TYPE_CHECKING:
    from deatwin.plant.recording import Recording


PARTS = ("real", "imaginary")
Variables = Mapping[str, tuple[Any, ...]]
"""By its name the dimensions of a variable (one or several), its values, and where it has them its unit and meaning."""


def dataset(
    variables: Variables, coords: Variables, attributes: Mapping[str, Any], document: Mapping[str, Any] | None = None
) -> Any:
    """Make a dataset that a NetCDF file can hold."""
    xarray = require("xarray", "a dataset")
    held = {name: _variable(*entry) for key, given in variables.items() for name, entry in _parts(key, *given)}
    if document is not None:
        text = json.dumps(document, ensure_ascii=False, allow_nan=False)
        held["document"] = ((), np.array(text), {"schema": str(document.get("schema", ""))})
    shown = {key: int(value) if isinstance(value, bool) else value for key, value in attributes.items()}
    kept = {key: value for key, value in shown.items() if value is not None and np.size(value)}
    return xarray.Dataset(held, coords={key: _variable(*entry) for key, entry in coords.items()}, attrs=kept)


def columns(dimension: str, rows: Iterable[Mapping[str, Any]], units: Mapping[str, str] | None = None) -> Variables:
    """The columns of a table as variables along a dimension, each with the dimension's name before its own."""
    listed = list(rows)
    found: dict[str, tuple[Any, ...]] = {}
    for key in dict.fromkeys(key for row in listed for key in row):
        values = [row.get(key) for row in listed]
        known = [value for value in values if value is not None]
        unit = (units or {}).get(key, "")
        if known and all(isinstance(value, str) for value in known):
            found[f"{dimension}_{key}"] = (dimension, np.array([value or "" for value in values]), unit)
        elif all(isinstance(value, (bool, int, float, np.number)) for value in known):
            numbers = [np.nan if value is None else float(value) for value in values]
            found[f"{dimension}_{key}"] = (dimension, np.array(numbers), unit)
    return found


def clock(records: Sequence[Recording], dimension: str = "sample") -> Variables:
    """Coordinates of all samples of several recordings, one after another. `dimension` along which the samples stand."""
    return {
        "time": (dimension, np.concatenate([record.timepts for record in records]), "s"),
        "record": (dimension, np.repeat(np.arange(len(records)), [record.n_samples for record in records])),
    }


def squared(unit: str) -> str:
    """The unit of a variance.

    Examples
    --------
    >>> squared("m/V"), squared("")
    ('(m/V)^2', '')
    """
    return f"({unit})^2" if unit else ""


def _parts(name: str, dimensions: Any, values: Any, *told: str) -> list[tuple[str, tuple[Any, ...]]]:
    """A variable, or the two that a complex one becomes."""
    array = np.asarray(values)
    if not np.iscomplexobj(array):
        return [(name, (dimensions, array, *told))]
    before = f"{name}_" if name else ""
    return [(before + part, (dimensions, v, *told)) for part, v in zip(PARTS, (array.real, array.imag), strict=True)]


def _variable(dimensions: Any, values: Any, *told: str) -> tuple[Any, np.ndarray, dict[str, str]]:
    attributes = {key: text for key, text in zip(("units", "long_name"), told, strict=False) if text}
    return dimensions, np.asarray(values), attributes
