"""Times that are not plain numbers with a unit: dates, times of day, Unix times.

The size of a Unix time tells its unit: from 2001-09-09, 1e9 s, to 2065, 3e9 s, numbers in s, ms, us and ns do not
overlap, and no clock has run for 32 years; above, numbers may be seconds since 1904, as LabVIEW counts. Counts of 100 ns
since 1601, as Windows has, or since the year 1, as .NET has, overlap with none of them.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal

import numpy as np

from deatwin.plant.files.dates import CLOCK, ORDERS, date_orders, day_seconds, is_clock, is_date, moment
from deatwin.plant.files.units import UNITS, Unit, find_unit
from deatwin.plant.safe_read import clipped

BEGAN = "clock_began"  # Key of the provenance for the date at which the clock is zero
DATES, TIMES_OF_DAY = "dates", "times of day"
TIME_UNITS = tuple(name for name, unit in UNITS.items() if unit.si == "s")
_SIZED = ("s", "ms", "us", "ns")
_FIRST, _LAST = 10**9, 3 * 10**9  # Range of values taken as Unix times, s: September 2001 to January 2065
_TICK = Unit("s", 1, 1e7)
_BEFORE_UNIX = {1601: 11_644_473_600, 1: 62_135_596_800}  # Seconds from the start of a year to that of 1970
_LIKE_CLOCK = re.compile(r"\d{5,6}([.,]\d*)?|\d{9}")  # from one o'clock on
_BEHIND = re.compile(r"[-+\d.,eE]*\d\s*([A-Za-z]+)")  # Number with a unit behind it
_GAP = 1.6  # Step above which there is a gap, in usual steps
_UNIX = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class TimeScale:
    """Column of times, read as seconds since its first value."""

    unit: str  # A key of `deatwin.plant.files.units.UNITS`; empty for dates and times of day
    began: datetime | None = None  # First value, at which the clock is zero; None if its date is unknown
    first: Decimal = Decimal(0)
    order: str = "dmy"
    behind: str = ""  # The unit as it stands behind each value
    year: int = 1970  # Year from whose start Unix times count, or ticks of 100 ns

    @property
    def texts(self) -> bool:
        """True if the values are dates or times of day, and not numbers."""
        return not self.unit

    @property
    def said(self) -> str:
        """Description of how the values were read."""
        if self.unit:
            return f"Unix times in {self.unit}" if self.year == 1970 else f"ticks of 100 ns since the year {self.year}"
        return DATES if self.began else TIMES_OF_DAY

    @property
    def count(self) -> Unit:
        """Unit of values that are numbers."""
        return UNITS[self.unit] if self.year == 1970 else _TICK

    @property
    def provenance(self) -> dict[str, str]:
        """Entry for the provenance; a date with an unknown order of day and month is omitted."""
        known = {BEGAN: self.began.isoformat()} if self.began and self.order else {}
        return {} if self.behind else {"times": self.said, **known}

    def seconds(self, cells: Sequence[str]) -> list[float]:
        """Return times as seconds since the first."""
        if self.texts:
            if (began := self.began) is None:
                times = day_seconds(cells)
                return [float(time - times[0]) for time in times]
            return [(moment(cell, self.order) - began).total_seconds() for cell in cells]
        if any("_" in cell for cell in cells):
            raise ValueError("Python's own mark between thousands")
        unit, first = self.count, self.first
        factor = Decimal(int(unit.numerator)) / Decimal(int(unit.denominator))
        return [float((Decimal(cell.strip().removesuffix(self.behind)) - first) * factor) for cell in cells]

    def fault(self, cell: str) -> str:
        """Describe the fault of a cell; empty if there is none."""
        if not self.texts:
            return ""
        if self.began is None:
            try:
                day_seconds([cell])
            except ValueError:
                return f'"{clipped(cell)}" is no time of day such as 12:00:00.25'
            return ""
        try:
            date = moment(cell, self.order)
        except ValueError:
            zone = (
                "; give a time zone as an offset from UTC, +02:00"
                if re.match(r"\D*\d.*[A-Za-z]{3}[^A-Za-z]*$", cell)
                else ""
            )
            return f'"{clipped(cell)}" is not a date, such as 2024-05-01 12:00:00.25 or 1.5.2024 12:00:00{zone}'
        if (date.tzinfo is None) != (self.began.tzinfo is None):
            return f'"{clipped(cell)}": of the dates, some have an offset from UTC and others have none'
        return ""


def time_scale(texts: Iterable[str], unit: str) -> TimeScale | None:
    """Return the reading of a column of times, or None if it holds plain numbers."""
    cells = iter(texts)
    first = next(cells, "").strip()
    if is_date(first):
        fitting = (unit,) if unit in ORDERS else date_orders([first, *cells])
        order = fitting[0] if len(fitting) == 1 else ""
        try:
            began = moment(first, order)
        except ValueError:
            began = datetime.min  # `fault` describes what is wrong
        return TimeScale(unit="", began=began, order=order)
    if is_clock(first) or unit == CLOCK:
        return TimeScale(unit="")
    behind = _BEHIND.fullmatch(first)
    if behind and (own := find_unit(behind[1])) in TIME_UNITS and unit in ("", own):
        return TimeScale(unit=own, behind=behind[1])
    if not unit and _LIKE_CLOCK.fullmatch(first) and (found := _of_day([first, *cells])):
        return found
    return None if unit in ORDERS else _unix(first, unit)


def _of_day(cells: Sequence[str]) -> TimeScale | None:
    """Return how to read numbers that go on as times of day do, 143100 after 143059; None if they are other numbers.

    The reading has no order if the numbers may as well be seconds.
    """
    try:
        times = np.array(day_seconds(cells), dtype=np.float64)
        numbers = np.array([cell.replace(",", ".") for cell in cells], dtype=np.float64)
    except ValueError:
        return None
    steps, other = np.diff(times), np.diff(numbers) / (1000.0 if re.fullmatch(r"\d{9}", cells[0].strip()) else 1.0)
    passed = np.abs(steps - other) > 1.0  # where a minute passes
    if not passed.any():
        return TimeScale(unit="") if cells[0].strip().startswith("0") else None
    even, also = (((one[passed] > 0.0) & (one[passed] <= _GAP * np.median(one))).any() for one in (steps, other))
    return TimeScale(unit="", order="dmy" if even and not also else "")


def _unix(first: str, unit: str) -> TimeScale | None:
    """Return how to read Unix times, or ticks; None if the first value is not one."""
    try:
        value = Decimal(first.replace(",", "."))
        for name in (unit,) if unit else _SIZED:
            seconds = value * int(UNITS[name].numerator) / int(UNITS[name].denominator)
            if _FIRST <= seconds < _LAST:
                began = _UNIX + timedelta(microseconds=int(seconds * 10**6))
                return TimeScale(unit=name, began=began, first=value)
        for year, before in () if unit else _BEFORE_UNIX.items():
            if _FIRST <= (seconds := value / int(_TICK.denominator) - before) < _LAST:
                began = _UNIX + timedelta(microseconds=int(seconds * 10**6))
                began = began if year == 1601 else began.replace(tzinfo=None)  # .NET counts local time, too
                return TimeScale(unit="s", began=began, first=value, year=year)
    except ArithmeticError:  # not a number, or outside the range of Decimal
        return None
    return None
