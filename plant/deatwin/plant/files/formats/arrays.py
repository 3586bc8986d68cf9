"""Tables of the binary formats, whose columns are arrays and whose units may be attributes."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.table import Declared, Table, Timing
from deatwin.plant.files.headers import for_name, split_unit
from deatwin.plant.files.times import TimeScale
from deatwin.plant.files.units import find_unit
from deatwin.plant.safe_read import COLUMNS, clipped

WIDEST = 64  # Largest number of signals in a matrix or an array of structs; wider matrices are images and maps
_UNITS = re.compile(
    r"(?i)(NI_|engineering)?[ _]?units?([ _]?(string|symbol|description))?"
)  # Attributes that name units
_SCALING = re.compile(
    r"(?i)(.*[ _])?(scale|scaling|gain|slope|offset|factor|multiplier|conversion|attenuation|divider|lsb)([ _].*)?"
    r"|((?!last|next|date|days?[ _]|year|time).*[ _])?calibration([ _](constant|coefficient|value))?|.*per[ _]?(count|bit|lsb|unit)"
)
"""Names of attributes that may say how numbers become values; of whole numbers, the resolution may, too. Dates and
numbers of a calibration do not."""
_QUOTIENT = re.compile(r"\s*([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*([^\d\s/:]+/[^\d\s/:]+)?\s*")
_FILLS = re.compile(
    r"(?i)_?fill_?value|missing_?value|no_?data(_?value)?"
)  # Attributes that name the numbers in place of missing values
_COUNTED = ("", "1", "count", "counts", "adu", "dn", "lsb", "raw")  # Units, in lower case, of values that are counts


@dataclass(frozen=True, kw_only=True, eq=False)
class ArrayTable(Table):
    """A table from a binary format, whose columns are arrays."""

    columns: tuple[NDArray[np.generic], ...]
    timings: tuple[Timing | None, ...] = ()
    dates: tuple[np.datetime64 | None, ...] = ()  # Dates of the columns' first samples, apart from `Timing.start`
    places: Mapping[str, str] = field(default_factory=dict)  # Headers of columns by their places in the file

    def row(self, sample: int) -> int:
        """Return the number of a sample; the first is 1, as in MATLAB and LabVIEW."""
        return sample + 1

    def column(self, wanted: str, works: Callable[[int], bool] = lambda column: True) -> int:
        """Return the number of a column, counted from 0, from its header, its name or its place in the file."""
        path = wanted.strip("/").replace("/", ".")  # of HDF5
        return super().column(self.places.get(wanted, self.places.get(path, wanted)), works)

    def texts(self, column: int) -> Iterator[str]:
        """Yield the values of a column as text."""
        return map(str, self.columns[column])

    def timing(self, columns: Sequence[int]) -> Timing | None:
        """Return the clock that the file states for some columns; None if it states none."""
        if not self.timings:
            return super().timing(columns)
        clocks = self._clocks(columns)
        first = clocks[0]
        for column, clock in zip(columns, clocks, strict=True):
            if clock != first:
                raise DataError(
                    f'{self.path}: "{self.shown(columns[0])}" and "{self.shown(column)}" have different '
                    f"clocks ({_said(first)}; {_said(clock)}); the channels of a recording "
                    "must have the same clock"
                )
        return first or super().timing(columns)

    def _clocks(self, columns: Sequence[int]) -> list[Timing | None]:
        """Return the clocks of some columns, from the earliest of their dates."""
        clocks = [self.timings[column] for column in columns]
        dates = [self.dates[column] if self.dates else None for column in columns]
        earliest = min((date for date in dates if date is not None), default=None)
        # Dates less than half a sample apart are those of channels that were started one after another.
        return [
            clock
            if clock is None or date is None or earliest is None
            else clock.later(float((date - earliest) / np.timedelta64(1, "s")))
            for clock, date in zip(clocks, dates, strict=True)
        ]

    def beside(self, column: int, others: Collection[int]) -> bool:
        """Return whether a column has as many samples as one of the others, if there are any."""
        return not others or len(self.columns[column]) in {len(self.columns[k]) for k in others}

    def si(self, columns: Sequence[int], *, missing: Collection[int] = ()) -> NDArray[np.float64]:
        """Return columns as numbers in SI units, (len(columns), n)."""
        length = len(self.columns[columns[0]])
        for column in columns:
            values, place = self.columns[column], f'{self.path}, column "{self.shown(column)}"'
            if values.dtype.kind not in "fiub":
                raise DataError(f"{place}: it holds {values.dtype} values; real numbers are needed")
            if not len(values):
                raise DataError(f"{place}: it is empty")
            if len(values) != length:
                raise DataError(
                    f'{place}: {len(values)} samples, but "{self.shown(columns[0])}" has {length}; '
                    "the columns of a recording must have the same number of samples"
                )
            numbers = values.astype(np.float64)
            if not (finite := np.isfinite(numbers) | (np.isnan(numbers) & (column in missing))).all():
                sample = int(np.argmin(finite))
                raise DataError(
                    f'{self.where(sample)}, column "{self.shown(column)}": {values[sample]} is not a finite number; put NaN in its place'
                )
        found = np.array([self._si(column) for column in columns])
        if (large := np.abs(found) > np.array([[self.largest(column)] for column in columns])).any():
            place, sample = np.argwhere(large)[0]
            raise DataError(
                f'{self.where(sample)}, column "{self.shown(columns[place])}": {self.columns[columns[place]][sample]:g} marks '
                "an overflow or a missing value; put NaN in its place, or give a true value in a larger unit"
            )
        return found

    def _si(self, column: int) -> NDArray[np.float64]:
        """Return a column in the wanted unit; values already in this unit stay unchanged, including -0.0."""
        if scale := self.scales.get(column):
            times = [*self.texts(column)] if scale.texts else []
            return np.array(scale.seconds(times)) if times else self._since_first(column, scale)
        values, unit = self.columns[column].astype(np.float64), self.unit(column)
        return values if unit.is_si else unit.to_si(values)

    def _since_first(self, column: int, scale: TimeScale) -> NDArray[np.float64]:
        """Return Unix times as seconds since the first, with exact subtraction of whole numbers."""
        values = self.columns[column]
        whole = values.dtype.kind in "iu"
        since = (values.astype(np.int64) - int(values[0])) if whole else values.astype(np.float64) - float(values[0])
        seconds = scale.count.to_si(since.astype(np.float64))
        # As a float, a date is known only to 0.24 us.
        return seconds if whole else np.round(seconds, 6)


def array_table(
    path: str,
    sha256: str,
    columns: Mapping[str, NDArray[np.generic]],
    units: Mapping[str, str],
    *,
    declared: Declared | None = None,
    timings: Mapping[str, Timing | None] | None = None,
) -> ArrayTable:
    """Make a table from arrays and their attributes."""
    if not columns:
        raise DataError(f"{path}: there are no vectors of numbers in it; a recording needs its signals as vectors")
    if len(columns) > COLUMNS:
        raise DataError(f"{path}: it has {len(columns)} columns; at most {COLUMNS} can be read")
    names, found = [], []
    for header in columns:
        said = units.get(header, "")
        (name, suffix), stated = split_unit(header), find_unit(said) or find_unit(f"({said})")
        if suffix and stated and suffix not in (stated, for_name(name, stated)):
            raise DataError(
                f'{path}, column "{clipped(header)}": the name gives the unit {suffix}, but its unit '
                f"attribute gives {stated}; correct one of them"
            )
        names.append(name)
        found.append(for_name(name, stated) or suffix)
    return ArrayTable(
        path=path,
        sha256=sha256,
        headers=tuple(columns),
        names=tuple(names),
        units=tuple(found),
        declared=declared or Declared(),
        said=tuple(units.get(header, "") for header in columns),
        columns=tuple(columns.values()),
        timings=tuple(timings[header] for header in columns) if timings else (),
    )


def of_matrix(name: str, value: np.ndarray, lengths: set[int]) -> dict[str, np.ndarray]:
    """Return the signals of a matrix, which run along its longer side; none if other vectors have other lengths."""
    if value.ndim != 2 or not 1 < min(value.shape) <= WIDEST or (lengths and max(value.shape) not in lengths):
        return {}
    if value.shape[0] >= value.shape[1]:
        return {f"{name}(:,{k})": column for k, column in enumerate(value.T, start=1)}
    return {f"{name}({k},:)": row for k, row in enumerate(value, start=1)}


def units_of(attributes: Mapping[str, Any]) -> list[str]:
    """Return the units that an attribute of a signal, or of several together, states; empty if there is none."""
    for name, value in attributes.items():
        if _UNITS.fullmatch(name):
            cells = np.ravel(np.asarray(value, dtype=object))
            texts = [cell.decode("utf-8", "replace") if isinstance(cell, bytes) else cell for cell in cells]
            if texts and all(isinstance(text, str) for text in texts):
                return texts
    return []


def require_no_scale(attributes: Mapping[str, Any], place: str, path: str, *, whole: bool = False) -> None:
    """Refuse a signal in a unit that has an attribute by which its numbers may still have to be scaled."""
    unit = " ".join(units_of(attributes))
    for name, number in (_quotients(attributes) | numeric(attributes)).items():
        scales = _SCALING.fullmatch(name) or (whole and name.lower() == "resolution")
        neutral = 0.0 if re.search(r"(?i)offset|[ _]db$", name) else 1.0
        if scales and number != neutral and unit.lower() not in _COUNTED:
            raise DataError(
                f'{path}: "{clipped(place)}" is in {clipped(unit)}, and its attribute "{clipped(name)}" is {number:g}, '
                "which is not applied; scale the values and remove it, or only remove it if they are in "
                f"{clipped(unit)} already (in HDF5 and NetCDF, scale_factor and add_offset are applied)"
            )


def unscaled(packed: np.ndarray, attributes: Mapping[str, Any], place: str, path: str) -> np.ndarray:
    """Return values unpacked as sections 2.5 and 8.1 of the CF conventions say; missing and invalid ones become nan."""
    known = numeric(attributes)
    if not known.keys() & {"scale_factor", "add_offset"}:
        require_no_scale(attributes, place, path, whole=packed.dtype.kind in "iu")
    if packed.dtype.kind == "i" and attributes.get("_Unsigned") in ("true", b"true"):
        packed = packed.view(packed.dtype.str.replace("i", "u"))
    fills = [np.ravel(value) for name, value in attributes.items() if _FILLS.fullmatch(name)]
    limits = {
        name: np.ravel(attributes[name]) for name in ("valid_range", "valid_min", "valid_max") if name in attributes
    }
    if packed.dtype.kind not in "fiu" or not (fills or limits or known.keys() & {"scale_factor", "add_offset"}):
        return packed
    values = packed.astype(np.float64) * float(known.get("scale_factor", 1.0)) + float(known.get("add_offset", 0.0))
    absent = np.zeros(packed.shape, dtype=bool)
    for numbers in (fill for fill in fills if fill.dtype.kind in "fiu"):
        with np.errstate(invalid="ignore"):
            absent |= np.isin(packed, numbers.astype(packed.dtype))
    for name, numbers in limits.items():
        if numbers.dtype.kind not in "fiu" or numbers.size != 1 + (name == "valid_range"):
            raise DataError(f'{path}: the attribute "{name}" of "{clipped(place)}" is {clipped(numbers)}; remove it')
        # Limits have the type of the numbers that they limit.
        limited = values if numbers.dtype.kind == "f" and packed.dtype.kind != "f" else packed
        absent |= (limited < numbers[0]) & (name != "valid_max") | (limited > numbers[-1]) & (name != "valid_min")
    return np.where(absent, np.nan, values)


def short_names(found: Mapping[str, Any]) -> dict[str, str]:
    """Return field names without the names of their structs or groups, if they stay unique."""
    last = {name: name.rpartition(".")[2] for name in found if not re.match(r"(?i)units?\.", name)}
    ends = list(last.values())
    return {name: last[name] if ends.count(last.get(name, "")) == 1 else name for name in found}


def numeric(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes that hold one number."""
    numbers = {name: np.ravel(value) for name, value in attributes.items()}
    return {name: value[0] for name, value in numbers.items() if value.size == 1 and value.dtype.kind in "fiu"}


def _quotients(attributes: Mapping[str, Any]) -> dict[str, float]:
    """Return the attributes that hold one number as text, alone or before a quotient such as ``1000 V/V``."""
    texts = {k: v.decode("utf-8", "replace") if isinstance(v, bytes) else v for k, v in attributes.items()}
    matches = {k: _QUOTIENT.fullmatch(v) for k, v in texts.items() if isinstance(v, str)}
    return {k: float(match[1]) for k, match in matches.items() if match}


def _said(timing: Timing | None) -> str:
    """Write a clock as text."""
    return f"every {timing.sample_time:g} s from {timing.start:g} s" if timing else "no clock"
