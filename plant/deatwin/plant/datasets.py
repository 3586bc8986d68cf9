"""Convert results to xarray datasets for NetCDF files: units, complex numbers, tables and documents."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.copies import Frozen
from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.optional import require
from deatwin.plant.recording import Experiment, Recording, as_experiment

PARTS = ("real", "imaginary")
Variables = Mapping[str, tuple[Any, ...]]
"""Variables by name: dimensions (one name or several), values and, where known, unit and meaning."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """Description of how a field or a derived value is stored in a dataset."""

    role: str
    dims: tuple[str, ...] = ()
    unit: str | Callable[[Any], str] = ""
    about: str = ""
    name: str | None = None
    of: Callable[[Any], Any] | None = None
    kind: type | None = None

    def unit_in(self, result: Any) -> str:
        """Return the unit, which may depend on the result."""
        return self.unit if isinstance(self.unit, str) else self.unit(result)


Metadata = Mapping[str, Entry]
_DATASET = "dataset"


def variable(*dims: str, **told: Any) -> Metadata:
    """Metadata of a variable along dimensions, the first ones for fewer axes; `told` sets fields of `Entry`."""
    return {_DATASET: Entry(role="variable", dims=dims, **told)}


def coordinate(*dims: str, **told: Any) -> Metadata:
    """Make metadata of a coordinate; the arguments are those of `variable`."""
    return {_DATASET: Entry(role="coordinate", dims=dims, **told)}


def attribute(**told: Any) -> Metadata:
    """Make metadata of an attribute of the dataset; `name` and `of` as for `variable`."""
    return {_DATASET: Entry(role="attribute", **told)}


def status_of(**told: Any) -> Metadata:
    """Make metadata of a status: its name becomes an attribute, its text the attribute ``advice``."""
    return {_DATASET: Entry(role="status", **told)}


def table_along(dimension: str, **told: Any) -> Metadata:
    """Make metadata of records whose fields become variables along a dimension; with `kind`, also without records."""
    return {_DATASET: Entry(role="table", dims=(dimension,), **told)}


def nested() -> Metadata:
    """Make metadata of an inner result that is stored in the same dataset."""
    return {_DATASET: Entry(role="nested")}


def several(of: Callable[[Any], Variables], role: str = "variables") -> Metadata:
    """Make metadata of variables (or ``coords``) whose names or dimensions depend on the result."""
    return {_DATASET: Entry(role=role, of=of)}


def document(of: Callable[[Any], Mapping[str, Any]]) -> Metadata:
    """Make metadata of the JSON document from which the result can be restored."""
    return {_DATASET: Entry(role="document", of=of)}


PART_COORDINATES: Mapping[str, Metadata] = {
    "part": coordinate("part", of=lambda _: list(PARTS)),
    "other_part": coordinate("other_part", of=lambda _: list(PARTS)),
}
"""Coordinates of a covariance of complex values."""


class _Brief(reprlib.Repr):
    """Short forms of the values of a result."""

    def repr_ndarray(self, values: np.ndarray, level: int) -> str:
        """Show a long array by its shape."""
        return repr(values) if values.size <= self.maxlist else f"<array {values.shape}>"

    repr_mappingproxy = reprlib.Repr.repr_dict


_BRIEF = _Brief()
_BRIEF.maxother = _BRIEF.maxstring = 80


class Brief(Frozen):
    """Base of results that show long arrays by their shapes."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):  # a dataclass keeps it; its own one would print every array
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        shown: tuple[Field[Any], ...] = fields(self) if is_dataclass(self) else ()
        values = (f"{each.name}={_BRIEF.repr(getattr(self, each.name))}" for each in shown if each.repr)
        return f"{type(self).__name__}({', '.join(values)})"


class Described(Brief):
    """Base of results whose fields describe, by metadata, how they are stored in a dataset."""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {}  # Metadata of properties and of values from `Entry.of`

    def to_xarray(self) -> Any:
        """Return the result as an `xarray.Dataset`, its variables with their units."""
        made = _Made()
        made.take(self)
        return dataset(made.variables, made.coords, made.attributes, made.document)


@dataclass(kw_only=True)
class _Made:
    """A dataset under construction."""

    variables: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    coords: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    attributes: dict[str, object] = field(default_factory=dict)
    document: Mapping[str, object] | None = None

    def take(self, result: Any) -> None:
        """Add the fields of a result."""
        for name, entry in _entries(type(result)).items():
            value = getattr(result, name) if entry.of is None else entry.of(result)
            shown = name if entry.name is None else entry.name
            if entry.role == "nested":
                self.take(value)
            elif entry.role == "document":
                self.document = value
            elif entry.role == "status":
                self.attributes |= {shown: value.name, "advice": value.value}
            elif entry.role == "attribute":
                self.attributes[shown] = value.value if isinstance(value, Enum) else value
            elif entry.role == "table":
                self.variables |= rows(entry, value, result)
            elif entry.role in ("variables", "coords"):
                getattr(self, entry.role).update(value)
            elif value is not None:
                into = self.coords if entry.role == "coordinate" else self.variables
                into[shown] = (entry.dims[: np.ndim(value)], value, entry.unit_in(result), entry.about)


def _told(kind: type) -> dict[str, Entry]:
    """Return what a class stores in its dataset, by field, property or name."""
    told = {each.name: each.metadata for each in fields(kind)} if is_dataclass(kind) else {}
    for base in reversed(kind.__mro__):
        told |= vars(base).get("DERIVED", {})
    return {name: metadata[_DATASET] for name, metadata in told.items() if _DATASET in metadata}


_entries: Callable[[Any], dict[str, Entry]] = cache(_told)


def rows(along: Entry, records: Iterable[Any], owner: Any = None) -> Variables:
    """Return records as the columns of a table, with units and meanings from their fields or their owner."""
    (dimension,), listed = along.dims, list(records)
    before = f"{dimension}_" if along.name is None else along.name
    kind = type(listed[0]) if listed else along.kind
    entries = {} if kind is None else _entries(kind)
    told = {before + name: (entry.unit_in(owner), entry.about) for name, entry in entries.items()}
    if not listed:
        return {name: (dimension, [], *about) for name, about in told.items()}
    values = [
        {**{each.name: getattr(record, each.name) for each in fields(record)}, **_derived(record, entries)}
        for record in listed
    ]
    plain = [{key: value.value if isinstance(value, Enum) else value for key, value in row.items()} for row in values]
    found = columns(dimension, plain, before=before)
    return {name: (*given[:2], *told.get(name, ())) for name, given in found.items()}


def _derived(record: Any, entries: Mapping[str, Entry]) -> dict[str, Any]:
    """Return entries that are no fields, or are stored differently in a table."""
    own = {each.name for each in fields(record)}
    return {
        name: getattr(record, name) if entry.of is None else entry.of(record)
        for name, entry in entries.items()
        if entry.of is not None or name not in own
    }


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


def columns(
    dimension: str, rows: Iterable[Mapping[str, Any]], units: Mapping[str, str] | None = None, before: str | None = None
) -> Variables:
    """Return the columns of a table as variables along a dimension; a text or the dimension begins each name."""
    listed, prefix = list(rows), f"{dimension}_" if before is None else before
    found: dict[str, tuple[Any, ...]] = {}
    for key in dict.fromkeys(key for row in listed for key in row):
        values = [row.get(key) for row in listed]
        known = [value for value in values if value is not None]
        unit = (units or {}).get(key, "")
        if known and all(isinstance(value, str) for value in known):
            found[prefix + key] = (dimension, np.array([value or "" for value in values]), unit)
        elif all(isinstance(value, (bool, int, float, np.number)) for value in known):
            numbers = [np.nan if value is None else float(value) for value in values]
            found[prefix + key] = (dimension, np.array(numbers), unit)
    return found


def clock(records: Sequence[Recording], dimension: str = "sample") -> Variables:
    """Return coordinates of all samples of several recordings, one after another, along `dimension`."""
    return {
        "time": (dimension, np.concatenate([record.timepts for record in records]), "s"),
        "record": (dimension, np.repeat(np.arange(len(records)), [record.n_samples for record in records])),
    }


def simulated_clock(given: Experiment | Recording, rows: Sequence[NDArray[np.float64]]) -> Variables:
    """Return the coordinates of the experiment of which one reading has the given `rows`, an array a recording."""
    records = as_experiment(given).recordings
    samples, simulated = [record.n_samples for record in records], [row.size for row in rows]
    if samples != simulated:
        raise DataError(
            f"the experiment has recordings of {samples} samples, but those of the simulation have {simulated}: give the "
            "experiment that was simulated"
        )
    return clock(records)


def one_unit(result: Any) -> str:
    """Return the unit of all outputs of a result; empty if they differ."""
    return str(result.units[0]) if len(set(result.units)) == 1 else ""


def gain_unit(result: Any) -> str:
    """Return the unit of a gain, output by input."""
    divided = result.output_unit and result.input_unit
    return str(f"{result.output_unit}/{result.input_unit}" if divided else result.output_unit)


def squared(unit: str) -> str:
    """The unit of a variance, such as ``(m/V)^2``."""
    return f"({unit})^2" if unit else ""


def _parts(name: str, dimensions: Any, values: Any, *told: str) -> list[tuple[str, tuple[Any, ...]]]:
    """Return a variable, or the two variables that store a complex one."""
    array = np.asarray(values)
    if not np.iscomplexobj(array):
        return [(name, (dimensions, array, *told))]
    before = f"{name}_" if name else ""
    return [(before + part, (dimensions, v, *told)) for part, v in zip(PARTS, (array.real, array.imag), strict=True)]


def _variable(dimensions: Any, values: Any, *told: str) -> tuple[Any, np.ndarray, dict[str, str]]:
    attributes = {key: text for key, text in zip(("units", "long_name"), told, strict=False) if text}
    return dimensions, np.asarray(values), attributes
