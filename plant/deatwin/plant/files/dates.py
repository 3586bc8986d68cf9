"""Dates and times of day as loggers and spreadsheets write them.

Year, month, day is ISO 8601, with strokes too. With points the day comes first, and a month by its name is certain.
Between strokes or dashes day and month change places from country to country, and a year of two digits may come first: a
number above 12 or 31 tells, else nothing does.
"""

import re
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal

ORDERS = ("dmy", "mdy", "ymd")  # Order of day and month, or of a year of two digits, as a user states it
CLOCK = "hhmmss"  # Times of day written as one number, 143005.25 for 14:30:05.25, as a user states it
_MONTHS = {
    start: month
    for month, starts in enumerate(
        (
            *("jan ene gen", "feb fév fev", "mar mär mae mrz mrt maa", "apr avr abr", "may mai mei mag maj"),
            *("jun juin giu", "jul juil lug", "aug aoû aou ago", "sep set", "oct okt ott out", "nov"),
            "dec dez dic déc",
        ),
        start=1,
    )
    for start in starts.split()
}
"""Months by the first letters of their names in English, German, Dutch, Swedish and the Romance languages."""
_ISO = re.compile(r"(\d{4})[-/.](\d\d?)[-/.](\d\d?)(?:[T ,]+(.*))?")
_OTHER = re.compile(r"(\d\d?)([-/.])(\d\d?)\2(\d{4}|\d\d)(?:[T ,]+(.*))?")
_COMPACT = re.compile(  # 14, 17 and 20 digits are no Unix time
    r"((?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01]))[T_]?"
    r"((?:[01]\d|2[0-3])[0-5]\d[0-5]\d)(?:[.,]?((?<=[.,])\d+|\d{3}(?:\d{3})?))?(Z|[+-]\d\d:?\d\d)?"
)
_CLOCK = re.compile(  # behind a colon, two digits may be hundredths, milliseconds or frames
    r"(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,:]((?<!:)\d+|\d{3}(?:\d{3})?))?)?\s*(?:([ap])\.?m\.?)?\s*(Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?",
    re.IGNORECASE,
)
_WORD = r"(?P<month>[^\W\d_]{3,10})"
_NAMED = tuple(
    re.compile(rf"(?:[^\W\d_]{{2,10}}[.,]* +)?{form}")  # perhaps behind the day of the week
    for form in (
        rf"(?P<day>\d\d?)(?:\.? ?|[-/]){_WORD}\.?[-/ ]?(?P<year>\d{{4}}|\d\d)(?:[T ,]+(?P<clock>.*))?",
        rf"(?P<year>\d{{4}})[-/. ]?{_WORD}\.?[-/ ]?(?P<day>\d\d?)(?:[T ,]+(?P<clock>.*))?",
        rf"{_WORD}\.? +(?P<day>\d\d?),? +(?P<year>\d{{4}})(?:,? +(?P<clock>.*))?",
        rf"{_WORD}\.? +(?P<day>\d\d?),? +(?P<clock>\d\d?:\S+) +(?P<year>\d{{4}})",  # as C writes it
    )
)
_ZONE = re.compile(r"(?<=Z|\d)\[[A-Za-z][\w/+-]*\]$")  # Name of the zone behind the offset, as RFC 9557 writes it
_ONE_NUMBER = re.compile(r"(\d\d)(\d\d)(\d\d)(?:[.,](\d+))?")
_DURATION = re.compile(r"(?:(?:(\d+) days?,? +)?(\d+):)?(\d{1,3}):(\d\d)(?:[.,](\d+))?")
_DAY, _HOUR = Decimal(86400), Decimal(3600)
_PAUSE, _STEPS = Decimal(10), 5  # Longest step past an hour, s or in steps before it, that is no new start of the clock


def is_date(cell: str) -> bool:
    """Return whether a cell begins like a date."""
    if _ISO.fullmatch(cell) or _COMPACT.fullmatch(cell):
        return True
    return _OTHER.fullmatch(cell) is not None or _named(cell) is not None


def _named(cell: str) -> re.Match[str] | None:
    """Return the parts of a date with the name of its month; None if it is none."""
    matches = (form.fullmatch(cell) for form in _NAMED)
    return next((found for found in matches if found and _month(found["month"])), None)


def _month(name: str) -> int:
    """Return the month of a name; 0 if it is none."""
    start = name.lower()[:4]
    return _MONTHS.get(start) or _MONTHS.get(start[:3], 0)


def is_clock(cell: str) -> bool:
    """Return whether a cell is a time of day or an elapsed time: with seconds, or with am or pm."""
    found = _CLOCK.fullmatch(cell)
    if found and not found[6] and (found[3] or found[5]):
        return True
    found = _DURATION.fullmatch(cell)
    return found is not None and (found[2] is not None or found[5] is not None)


def date_orders(cells: Iterable[str]) -> tuple[str, ...]:
    """Return the entries of `ORDERS` that fit all dates of a column; the first one if none does."""
    left: tuple[str, ...] = ORDERS
    for cell in cells:
        found = _OTHER.fullmatch(cell.strip())
        if found is None or found[2] == ".":
            return ORDERS[:1]
        first, second, last = int(found[1]), int(found[3]), int(found[4])
        fits = {
            "dmy": first <= 31 and second <= 12,
            "mdy": first <= 12 and second <= 31,
            "ymd": len(found[1]) == 2 and second <= 12 and 1 <= last <= 31,  # a year of four digits is no day
        }
        left = tuple(order for order in left if fits[order])
        if len(left) < 2:
            break
    return left or ORDERS[:1]


def moment(text: str, order: str = "dmy") -> datetime:
    """Return a date; in UTC if it has an offset. Raise ValueError if it is none."""
    cell = _ZONE.sub("", text.strip())
    try:
        parts = _COMPACT.fullmatch(cell)
        plain = f"{parts[1]}T{parts[2]}.{parts[3] or 0}{parts[4] or ''}" if parts else cell
        found = datetime.fromisoformat(plain)
    except ValueError:
        found = _moment(cell, order)
    try:
        return found.astimezone(UTC) if found.tzinfo else found
    except OverflowError:
        raise ValueError("before the first year, or behind the last one") from None


def _moment(cell: str, order: str) -> datetime:
    """Return a date in a format that `datetime.fromisoformat` does not know."""
    if found := _ISO.fullmatch(cell):
        year, month, day, clock = found[1], found[2], found[3], found[4]
    elif found := _OTHER.fullmatch(cell):
        parts = dict(zip(order or ORDERS[0], (found[1], found[3], found[4]), strict=True))
        day, month, year, clock = parts["d"], parts["m"], parts["y"], found[5]
    elif found := _named(cell):
        year, month, day, clock = found["year"], str(_month(found["month"])), found["day"], found["clock"]
    else:
        raise ValueError("no date")
    date = datetime(int(year if len(year) == 4 else f"20{year}"), int(month), int(day))
    if not clock:
        return date
    time = _CLOCK.fullmatch(clock)
    if time is None or not 0 <= (hour := _hour(time)) < 24 or int(time[2]) > 59 or int(time[3] or 0) > 59:
        raise ValueError("no time of day")
    micro = int(f"{time[4] or 0:0<6}"[:6])
    date += timedelta(hours=hour, minutes=int(time[2]), seconds=int(time[3] or 0), microseconds=micro)
    if not time[6]:
        return date
    hours, minutes = (
        (0, 0) if time[6][0].isalpha() else (int(time[6][:3]), int(time[6][0] + (time[6][3:].strip(":") or "0")))
    )
    return date.replace(tzinfo=timezone(timedelta(hours=hours, minutes=minutes)))


def _hour(time: re.Match[str]) -> int:
    """Return the hour of the day from 0 to 23; -1 for an invalid hour of a twelve-hour clock."""
    hour = int(time[1])
    if not time[5]:
        return hour
    return hour % 12 + (12 if time[5].lower() == "p" else 0) if 1 <= hour <= 12 else -1


def day_seconds(cells: Iterable[str]) -> list[Decimal]:
    """Return times of day, or elapsed ones, as seconds that go on past midnight, where they fall by half a day.

    Minutes without hours, as in 59:59.9, go on past the hour, if that makes no pause: they may also start again.
    """
    found: list[Decimal] = []
    passed = Decimal(0)
    for cell in cells:
        seconds, period = _of_day(cell.strip())
        if found and seconds + passed < found[-1] - period / 2 and seconds < period:
            pause, usual = seconds + passed + period - found[-1], found[-1] - found[max(len(found) - 2, 0)]
            passed += period if period == _DAY or pause <= max(_PAUSE, _STEPS * usual) else 0
        found.append(seconds + passed)
    return found


def _of_day(cell: str) -> tuple[Decimal, Decimal]:
    """Return a time of day, or an elapsed time, and the period after which it begins anew, in seconds."""
    period = _DAY
    clock = _CLOCK.fullmatch(cell)
    if clock and not clock[6] and (clock[3] or clock[5]):
        hour, minutes, seconds, fraction = _hour(clock), clock[2], clock[3], clock[4]
    elif (long := _DURATION.fullmatch(cell)) and (long[2] or long[5]):
        hour = 24 * int(long[1] or 0) + int(long[2] or 0)
        period = _DAY if long[2] else _HOUR
        minutes, seconds, fraction = long[3], long[4], long[5]
    elif number := _ONE_NUMBER.fullmatch(_padded(cell)):
        hour, (minutes, seconds, fraction) = int(number[1]), number.groups()[1:]
    else:
        raise ValueError("no time of day")
    if hour < 0 or (int(minutes) > 59 and period == _DAY) or int(seconds or 0) > 59:
        raise ValueError("no time of day")
    return Decimal(f"{3600 * hour + 60 * int(minutes) + int(seconds or 0)}.{fraction or 0}"), period


def _padded(cell: str) -> str:
    """Return a time of day that is one number with all its digits, and a point before thousandths."""
    whole = re.split("[.,]", cell)[0]
    return f"{cell[:6]}.{cell[6:]}" if len(cell) == len(whole) == 9 else "0" * (6 - len(whole)) + cell
