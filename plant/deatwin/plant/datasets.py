"""Results as xarray datasets, which NetCDF files hold: one place for units, complex numbers, tables and documents."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.files.formats.optional import require

if TYPE_CHECKING:
    from deatwin.plant.recording import Recording

__all__ = ["PARTS", "Variables", "clock", "columns", "dataset", "squared"]

PARTS = ("real", "imaginary")
Variables = Mapping[str, tuple[Any, ...]]
"""By its name the dimensions of a variable (one or several), its values, and where it has them its unit and meaning."""


def dataset(
    variables: Variables, coords: Variables, attributes: Mapping[str, Any], document: Mapping[str, Any] | None = None
) -> Any:
    """Make a dataset that a NetCDF file can hold.

    Parameters
    ----------
    variables, coords : mapping of str to tuple
        Dimensions, values, unit and meaning of each. A complex variable becomes two, ``real`` and ``imaginary`` after
        its name, or these alone for a variable without a name.
    attributes : mapping of str to str, number, sequence or None
        Of the whole; None and empty sequences are left out, a truth value is written as 0 or 1.
    document : mapping, optional
        What `save` writes as JSON. It goes as text into the variable ``document``, so that nothing is lost: what the
        result's ``from_dict`` or `load` reads.

    Returns
    -------
    xarray.Dataset
        With the unit of each variable in its attribute ``units``, and what it means in ``long_name``.

    Raises
    ------
    DataError
        If xarray is not installed.
    """
    xarray = require("xarray", "a dataset")
    held = {name: _variable(*entry) for key, given in variables.items() for name, entry in _parts(key, *given)}
    if document is not None:
        text = json.dumps(document, ensure_ascii=False, allow_nan=False)
        held["document"] = ((), np.array(text), {"schema": str(document.get("schema", ""))})
    shown = {key: int(value) if isinstance(value, bool) else value for key, value in attributes.items()}
    kept = {key: value for key, value in shown.items() if value is not None and np.size(value)}
    return xarray.Dataset(held, coords={key: _variable(*entry) for key, entry in coords.items()}, attrs=kept)


def columns(dimension: str, rows: Iterable[Mapping[str, Any]], units: Mapping[str, str] | None = None) -> Variables:
    """The columns of a table as variables along a dimension, each with the dimension's name before its own.

    Parameters
    ----------
    dimension : str
        Along which the rows stand.
    rows : iterable of mapping
        Flat; what a row does not have, or has as None, is NaN among numbers and empty among texts. Values that are
        neither number nor text are left out.
    units : mapping of str to str, optional
        Of columns that have one.

    Returns
    -------
    mapping of str to tuple
        As `dataset` takes them; nothing where there are no rows.
    """
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
    """Coordinates of all samples of several recordings, one after another.

    Parameters
    ----------
    records : sequence of Recording
        In their order.
    dimension : str
        Along which the samples stand.

    Returns
    -------
    mapping of str to tuple
        ``time`` on the running clock in s, and ``record``, the number of the recording from 0 on.
    """
    return {
        "time": (dimension, np.concatenate([record.timepts for record in records]), "s"),
        "record": (dimension, np.repeat(np.arange(len(records)), [record.n_samples for record in records])),
    }


def squared(unit: str) -> str:
    """The unit of a variance.

    Parameters
    ----------
    unit : str
        Of the quantity; empty where it is not known.

    Returns
    -------
    str

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
