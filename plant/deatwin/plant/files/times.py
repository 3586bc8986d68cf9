"""Times that are no plain numbers of a unit: dates of ISO 8601, and Unix times.

A Unix time counts from 1970-01-01 in UTC. Its size tells its unit: from 2001-09-09, when it was 1e9 s, to 2065, when it
will be 3e9 s, the numbers in s, ms, us and ns do not overlap. A clock that has run for 32 years is no other
explanation; above, numbers may be seconds since 1904, as LabVIEW counts. Where the unit is stated, only that one is
tried.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal

from deatwin.plant.files.csvtext import is_date
from deatwin.plant.files.units import UNITS
from deatwin.plant.intake import clipped

BEGAN = "clock_began"
"""The provenance that holds the date of a clock's zero."""
DATES = "dates of ISO 8601"
TIME_UNITS = tuple(name for name, unit in UNITS.items() if unit.si == "s")
_SIZED = ("s", "ms", "us", "ns")
_FIRST, _LAST = 10**9, 3 * 10**9  # s
_UNIX = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class TimeScale:
    """How a column of times is read: as seconds since its first value."""

    unit: str  # A key of `deatwin.plant.files.units.UNITS`; empty for dates
    began: datetime  # The first value, which is the zero of the clock
    first: Decimal = Decimal(0)

    @property
    def dates(self) -> bool:
        """Whether the values are dates, and no numbers."""
        return not self.unit

    @property
    def said(self) -> str:
        """What the values were taken as."""
        return DATES if self.dates else f"Unix times in {self.unit}"

    def seconds(self, cells: Sequence[str]) -> list[float]:
        """Return times as seconds since the first."""
        if self.dates:
            began = self.began
            return [_since(moment(cell), began) for cell in cells]
        if any("_" in cell for cell in cells):
            raise ValueError("Python's own mark between thousands")
        unit, first = UNITS[self.unit], self.first
        factor = Decimal(int(unit.numerator)) / Decimal(int(unit.denominator))
        return [float((Decimal(cell.strip()) - first) * factor) for cell in cells]

    def fault(self, cell: str) -> str:
        """Return what is wrong with a cell, empty where nothing is."""
        if not self.dates:
            return ""
        try:
            date = moment(cell)
        except ValueError:
            return f'"{clipped(cell)}" is no date of ISO 8601, such as 2024-05-01 12:00:00.25'
        if (date.tzinfo is None) != (self.began.tzinfo is None):
            return f'"{clipped(cell)}": of the dates, some have an offset from UTC and others have none'
        return ""


def moment(text: str) -> datetime:
    """Return a date of ISO 8601, with a stroke for each dash also.

    Examples
    --------
    >>> moment("2024-05-01 12:00:00.5"), moment("2024-05-01T14:00:00+02:00").isoformat()
    (datetime.datetime(2024, 5, 1, 12, 0, 0, 500000), '2024-05-01T12:00:00+00:00')
    """
    found = datetime.fromisoformat(text.strip().replace("/", "-"))
    try:
        return found.astimezone(UTC) if found.tzinfo else found
    except OverflowError:
        raise ValueError("before the first year, or behind the last one") from None


def time_scale(first: str, unit: str) -> TimeScale | None:
    """Return how a column of times is read, or None where it holds plain numbers.

    Examples
    --------
    >>> time_scale("1714564800500", "").said, time_scale("1714564800500", "").began.isoformat()
    ('Unix times in ms', '2024-05-01T12:00:00.500000+00:00')
    >>> time_scale("12.5", "")
    """
    if is_date(first.strip()):
        try:
            return TimeScale(unit="", began=moment(first))
        except ValueError:
            return None
    try:
        value = Decimal(first.strip().replace(",", "."))
        for name in (unit,) if unit else _SIZED:
            seconds = value * int(UNITS[name].numerator) / int(UNITS[name].denominator)
            if _FIRST <= seconds < _LAST:
                began = _UNIX + timedelta(microseconds=int(seconds * 10**6))
                return TimeScale(unit=name, began=began, first=value)
    except ArithmeticError:  # no number, or one beyond decimal ones
        return None
    return None


def _since(date: datetime, began: datetime) -> float:
    """Return the seconds between two dates."""
    return (date - began).total_seconds()
