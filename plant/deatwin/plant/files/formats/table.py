"""The table into which every file format is read: named columns of numbers, and declarations of the file."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.headers import said_unit
from deatwin.plant.files.times import TimeScale
from deatwin.plant.files.units import UNITS, Unit, find_unit
from deatwin.plant.safe_read import clipped
from deatwin.plant.words import first_of

_SAME_CLOCK = 1e-3  # Relative difference below which two sample times mean the same clock
_NO_UNITS = ("", "-", "–", "1")  # Entries in a line of units that stand for no unit
OVERFLOW = 1e29  # Number in a file above which it marks an overflow or a missing value, as 1e30 and 9.91e37 do
_LISTED = 20  # Largest number of headers that an error lists


def is_place(wanted: str) -> bool:
    """Return whether a column is given by its position, such as ``#2``."""
    return re.fullmatch(r"#[1-9][0-9]{0,8}", wanted) is not None


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One channel of a recording."""

    role: str  # ``input``, ``output`` or ``extra``
    name: str  # Name in the recording
    unit: str  # SI unit; empty if unknown
    header: str  # Header of its column in the file


@dataclass(frozen=True, kw_only=True)
class Timing:
    """An even clock that a file states instead of a column of times."""

    sample_time: float  # Time between two samples, s
    start: float = 0.0  # Time of the first sample, s

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sample_time) and self.sample_time > 0.0 and np.isfinite(self.start)):
            raise DataError(f"sample time {self.sample_time} s from {self.start} s: it must be positive and finite")

    def later(self, seconds: float) -> "Timing":
        """Return this clock started later, by whole samples."""
        return replace(self, start=self.start + self.sample_time * round(seconds / self.sample_time))

    def agrees(self, sample_time: float) -> bool:
        """Return whether another sample time, s, means the same clock."""
        return abs(sample_time / self.sample_time - 1.0) < _SAME_CLOCK


@dataclass(frozen=True, kw_only=True)
class Declared:
    """Statements of a file about its recording, besides the columns."""

    timing: Timing | None = None  # Clock; None if the file states none
    signals: tuple[Signal, ...] = ()  # Meaning of the columns; empty if only the headers show it
    provenance: Mapping[str, str] = field(default_factory=dict)  # Origin of the samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Table(ABC):
    """Named columns of a file."""

    path: str  # Path of the file, as errors show it
    sha256: str  # Hash of the file's bytes
    headers: tuple[str, ...]  # Headers of the columns as in the file
    names: tuple[str, ...]
    units: tuple[str, ...]
    declared: Declared = Declared()  # Declarations in the file besides the columns
    nameless: bool = False  # True if the file has no header, so that positions serve as headers: ``#1``, ``#2``
    scales: Mapping[int, TimeScale] = field(default_factory=dict)
    said: tuple[str, ...] = ()
    wanted: Mapping[int, Unit] = field(default_factory=dict)
    delimiter: str = ","
    marks: tuple[float, ...] = ()  # Numbers that mark missing values, as the file says
    scale: str = ""  # Scale or factor in a remark of the file, which is not applied
    rate: tuple[str, float] | None = None  # Remark of the file on its sample time, and this time, s
    left_out: str = ""  # Last row if it was left out because the file breaks off within it, and how that shows

    @abstractmethod
    def texts(self, column: int) -> Iterator[str]:
        """Yield the values of a column, counted from 0, as text; empty for a missing value."""

    @abstractmethod
    def row(self, sample: int) -> int:
        """Return the row of a sample in the file."""

    @abstractmethod
    def si(self, columns: Sequence[int], *, missing: Collection[int] = ()) -> NDArray[np.float64]:
        """Return columns in SI units, or in those of `wanted`; NaN for missing values in columns of `missing`."""

    def without_cut_number(self, columns: Collection[int]) -> "Table":
        """Return the table without its last row if that ends, in one of some columns, with a number that seems cut short."""
        return self

    def unit(self, column: int) -> Unit:
        """Return the unit of a column, which converts to the wanted unit."""
        known = self.units[column]
        own = next((s.unit for s in self.declared.signals if s.header == self.headers[column]), "")
        if known and find_unit(own) == known:  # the file declares this unit, which is kept
            return self.wanted.get(column, Unit(own))
        return self.wanted.get(column) or (UNITS[known] if known else Unit(self.own_unit(column)))

    def largest(self, column: int) -> float:
        """Return the largest SI value that is no mark of an overflow; a recording that deatwin wrote holds no marks."""
        declared = self.headers[column] in {signal.header for signal in self.declared.signals}
        return np.inf if declared else float(self.unit(column).to_si(np.array(OVERFLOW)))

    def own_unit(self, column: int) -> str:
        """Return the unit of a column, counted from 0; an unknown unit is returned as spelled in the file."""
        said = self.said[column].strip("()[] ") if self.said else ""
        said = "" if said in _NO_UNITS else said
        return self.units[column] or said or said_unit(self.headers[column])

    def where(self, sample: int) -> str:
        """Return file and row of a sample, for an error text."""
        return f"{self.path}, row {self.row(sample)}"

    def timing(self, columns: Sequence[int]) -> Timing | None:
        """Return the clock that the file states for some columns; None if it states none."""
        return self.declared.timing

    def beside(self, column: int, others: Collection[int]) -> bool:
        """Return whether a column has as many samples as one of the others, as the columns of a text always have."""
        return True

    def column(self, wanted: str, works: Callable[[int], bool] = lambda column: True) -> int:
        """Return the number of a column, counted from 0."""
        if is_place(wanted) and wanted not in self.headers:
            if int(wanted[1:]) > len(self.headers):
                raise DataError(f"{self.path}: no column {wanted}; the file has {len(self.headers)} columns")
            return int(wanted[1:]) - 1
        found = [k for k, header in enumerate(self.headers) if header == wanted]
        found = found or [k for k, name in enumerate(self.names) if name == wanted]
        if not found:  # µ and other signs have two codes that look alike
            like = normalize("NFKC", wanted)
            pairs = zip(self.headers, self.names, strict=True)
            found = [k for k, pair in enumerate(pairs) if like in (normalize("NFKC", text) for text in pair)]
        if not found:
            parts = [part.strip() for part in wanted.split(",")]
            if len(parts) > 1 and (listed := [p for p in parts if p in (*self.headers, *self.names)]):
                fits = [part for part in listed if works(self.column(part))]
                one = f': "{clipped(fits[0])}"' if fits else ""
                raise DataError(f'{self.path}: "{clipped(wanted)}" names several columns; name one{one}')
            raise DataError(
                f'{self.path}: no column "{clipped(wanted)}"; the file has {self.listing()}{self.near(wanted, works)}'
            )
        if len(found) > 1:
            different = len({self.headers[k] for k in found}) == len(found) <= _LISTED
            whole = " or ".join(f'"{self.shown(k)}"' for k in found)
            place = f"its position, for example #{next(filter(works, found), found[0]) + 1}"
            raise DataError(
                f'{self.path}: the column "{clipped(wanted)}" occurs {len(found)} times; name one by '
                f"{f'its whole header, {whole}' if different else place}"
            )
        return found[0]

    def near(self, wanted: str, works: Callable[[int], bool]) -> str:
        """Return the end of an error text that suggests the header nearest to a misspelt one."""
        like = [k for k, header in enumerate(self.headers) if nearest(wanted, [header])]
        return nearest(wanted, [self.headers[k] for k in like if self.headers.count(self.headers[k]) == 1 and works(k)])

    def columns_of(self, role: str) -> tuple[int, ...]:
        """Return the columns that the file declares."""
        return tuple(self.column(signal.header) for signal in self.declared.signals if signal.role == role)

    def signal(self, role: str, column: int) -> Signal:
        """Return the internal name of a column, and its SI unit."""
        header = self.headers[column]
        for declared in self.declared.signals:
            if declared.header == header:
                return replace(declared, unit=self.wanted[column].si) if column in self.wanted else declared
        return Signal(role=role, name=self.names[column], unit=self.unit(column).si, header=header)

    def listing(self) -> str:
        """Return the headers as one text; if there are many, only the first ones."""
        return first_of([f'"{self.shown(column)}"' for column in range(len(self.headers))], _LISTED)

    def shown(self, column: int) -> str:
        """Return a header for an error text."""
        return clipped(self.headers[column])

    def unmistakable(self, column: int) -> str:
        """Return the header of a column, or its position if other columns have the same header."""
        header = self.headers[column]
        written = self.shown(column) == header and self.headers.count(header) == 1  # neither clipped nor escaped
        return header if header and written else f"#{column + 1}"
