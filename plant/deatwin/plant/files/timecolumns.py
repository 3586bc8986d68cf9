"""Find the column of a table that holds the times, and its unit."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import even_pieces
from deatwin.plant.files.dates import CLOCK, ORDERS, date_orders, day_seconds, is_clock, is_date, moment
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.headers import TIME_NAMES
from deatwin.plant.files.times import TIME_UNITS, time_scale
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.files.usual import LIKE_TIMES, USUAL_TIMES
from deatwin.plant.files.wanted import split_stated
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.resampling import resampling_options
from deatwin.plant.safe_read import clipped

Floats = NDArray[np.float64]
_STAMP_NAMES = (
    *("ts", "timestamp", "datetime", "unixtime", "times", "elapsed", "elapsedtime", "date", "zeitstempel"),
    *("utc", "utctime", "gpstime", "filetime", "relativetime", "reltime", "testtime", "timeutc", "timeofday", CLOCK),
    *("datum", "datumuhrzeit", "datumzeit", "horodatage", "fecha", "fechahora"),
)
_CALENDARS = ((32874.0, 73051.0), (726834.0, 767011.0), (2447892.0, 2488070.0))
"""Days from 1990 to 2100, counted from 1900, from 0, and as Julian dates."""
_DIGITS = 20  # Largest number of digits of a counter
_SHORT = 1e-4  # Step below which times in s may be days, in which it is less than nine seconds
_ROUNDED = 1e-6  # Relative error of a step from times with too few digits
_ONE_NUMBER = re.compile(r"(?i)(.*[^a-z])?hhmmss([^a-z].*)?")  # Header of times of day that are one number
_IN_WORDS = re.compile(r".*\s(?:in|en)\s+([^\W\d_]+)")  # Header that ends in words for a unit, known or not
_FIRST = re.compile(r"\((:,1|1,:)\)$")  # End of the header of a matrix's first column or row
_LISTED = 5  # Largest number of columns that an error lists


def time_column(
    table: Table, taken: set[int], wanted: str | None = None, *, needed: bool = True
) -> tuple[int | None, str]:
    """Return the column of the times and its unit: as named, called ``time``, with a unit of time, or evenly rising."""
    if wanted is not None:
        return _named_times(table, taken, wanted)
    free = [column for column in range(len(table.headers)) if column not in taken and table.beside(column, taken)]
    timed = [column for column in free if UNITS[table.units[column]].si == "s"]
    # A column named time without a unit is in seconds, or holds dates.
    likely = [column for column in free if column in timed or not table.units[column]]
    usual = [column for column in likely if table.headers[column] == USUAL_TIMES]
    named = [column for column in likely if _plain(table.names[column]) in TIME_NAMES]
    stamped = [column for column in likely if _plain(table.names[column]) in _STAMP_NAMES]
    # The date of a day, and the time of the start, stand in all rows.
    named, stamped, timed = ([k for k in some if not _is_constant(table, k)] for some in (named, stamped, timed))
    fields = [column for column in likely if _plain(_field(table.names[column])) in (*TIME_NAMES, *_STAMP_NAMES)]
    inner = [column for column in fields if needed and holds_times(table, column)]
    dated = [column for column in likely if not table.headers[column] and _is_dated(table, column)]
    dated = dated or [k for k in likely if needed and _is_dated(table, k) and holds_times(table, k)]
    first = [0] if needed and is_nameless(table) and 0 in free and _uneven(table, 0) == NO_OPTIONS else []
    found = usual or named or stamped or timed or inner or dated or first
    groups = {_group(table.names[column]) for column in taken}
    found = [column for column in found if _group(table.names[column]) in groups] or found
    if len(found) > 1 and found == timed:  # some of them may be durations
        found = [column for column in found if holds_times(table, column) or _breaks_off(table, column)] or found
    if len(found) > 1 and needed and not _equal(table, found):
        own = {max((k for k in found if k < column), default=found[0]) for column in taken}  # each before its signals
        if len(own) == 1 and found[0] == 0 and len({table.headers[column] for column in found}) == 1:
            (column,) = own  # of one of several tables side by side, each of which begins with its times
            return column, table.units[column]
        listed = " and ".join(f'"{table.shown(column)}"' for column in found[:_LISTED])
        apart = "so input and output may have clocks of their own; interpolate one to the times of the other, and remove its times"
        if any(_breaks_off(table, column) for column in found):
            raise DataError(
                f"{table.path}: the columns {listed} hold different times, and one of them ends before the others, {apart}"
            )
        if len(own) > 1:
            raise DataError(
                f"{table.path}: each of the columns {listed} may hold the times, and they differ, {apart}; or name the column "
                "with the times of both: --time-column"
            )
        one = ReadOptions(time_column=table.unmistakable(next((k for k in found if holds_times(table, k)), found[0])))
        raise DataError(
            f"{table.path}: each of the columns {listed} may hold the times, and they differ; name the column with the times of input and output: {one}",
            one,
        )
    return (found[0], table.units[found[0]]) if len(found) == 1 or (found and needed) else (None, "")


def is_nameless(table: Table) -> bool:
    """Return whether the first column has no name: that of a file without a header, or of a matrix."""
    return table.nameless or _FIRST.search(table.headers[0]) is not None


def _is_constant(table: Table, column: int) -> bool:
    """Return whether a column holds the same text in all rows, at least two."""
    cells = table.texts(column)
    first, second = next(cells, ""), next(cells, None)
    return first == second and all(cell == first for cell in cells)


def _is_dated(table: Table, column: int) -> bool:
    """Return whether a column begins with a date or a time of day, as the nameless index of a data frame may do."""
    first = next(table.texts(column), "").strip()
    return is_date(first) or is_clock(first)


def _breaks_off(table: Table, column: int) -> bool:
    """Return whether a column ends before the others, as the times of a slower channel do."""
    cells = list(table.texts(column))
    count = max((k for k, cell in enumerate(cells, 1) if cell.strip()), default=0)
    return 1 < count < len(cells) and all(map(str.strip, cells[:count]))


def _equal(table: Table, columns: list[int]) -> bool:
    """Return whether columns hold the same times, as in a file with times beside each channel."""
    try:
        first, *others = (with_times(table, column, table.units[column]).si([column])[0] for column in columns)
    except DataError:
        return False
    return all(np.array_equal(first, other) for other in others)


def _plain(name: str) -> str:
    """Return a name without capitals, blanks, underscores and a bracketed suffix such as a time zone or an index."""
    return re.sub(r"[\s/&+_-]|\(.*\)$|\[\d+\]$", "", name).lower()


def _group(name: str) -> str:
    """Return the struct or group to which a column belongs, from its name."""
    return re.match(r"(.*[./])?", name, re.DOTALL)[0]  # type: ignore[index]  # it matches anything


def _field(name: str) -> str:
    """Return the last part of the name of a struct's field, which keeps the struct's name if others have such a field."""
    return name.removeprefix(_group(name)) if re.fullmatch(r"\w+(\(\d+\))?(\.\w+(\(\d+\))?)+", name) else ""


def _named_times(table: Table, taken: set[int], wanted: str) -> tuple[int, str]:
    """Return the column of the times that the user names, and its unit."""
    name, behind = split_stated(table, wanted)
    stated = ""
    if behind:
        stated = behind if behind in (*ORDERS, CLOCK) else find_unit(behind)
        if stated not in (*TIME_UNITS, *ORDERS, CLOCK):
            raise DataError(
                f'{table.path}: the times are said to be in "{clipped(behind)}"; known are the units {", ".join(TIME_UNITS)}; '
                "for dates, write dmy if the day comes first, mdy if the month does, and ymd if a year of two digits does; "
                f"for 143005.25 in place of 14:30:05.25, write {CLOCK}"
            )
    column = table.column(name, lambda column: column not in taken and holds_times(table, column, stated))
    header = table.headers[column]
    # Behind the name of a time, h and min are units.
    own = table.units[column] or (unit if UNITS[unit := find_unit(header.rpartition("_")[2])].si == "s" else "")
    if own and UNITS[own].si != "s":
        raise DataError(
            f'{table.path}: the column "{clipped(header)}" is in {own}; a column of times must be in a unit of time, such as s'
        )
    if own and stated and own != stated:
        raise DataError(
            f'{table.path}: the column "{clipped(header)}" is in {own}, but its times are said to be in {stated}; '
            f'remove "={clipped(behind)}"'
        )
    return column, own or stated


def holds_times(table: Table, column: int, unit: str = "") -> bool:
    """Return whether a column can be the times: increasing numbers or dates, in no unit of another kind."""
    return _uneven(table, column, unit) is not None


def likely_times(table: Table, taken: set[int]) -> list[int]:
    """Return columns that may be the times: those on an even clock, else those that can be resampled to one."""
    ways = {k: way for k in range(len(table.headers)) if k not in taken and (way := _uneven(table, k)) is not None}
    ways = {k: way for k, way in ways.items() if table.nameless or not numbers_rows(table, k)}
    return [k for k, way in ways.items() if not way] or list(ways)


def numbers_rows(table: Table, column: int) -> bool:
    """Return whether a column without a name of times counts the rows, so that it tells nothing of the sample time."""
    if table.units[column] or LIKE_TIMES.search(table.names[column]):
        return False
    return counts_by_one(list(table.texts(column)))


def is_count(cell: str) -> bool:
    """Return whether a cell holds a number that a counter can hold."""
    return cell.isdecimal() and len(cell) <= _DIGITS


def counts_by_one(cells: Sequence[str]) -> bool:
    """Return whether each cell counts on from the one before."""
    return all(map(is_count, cells)) and {int(after) - int(before) for before, after in pairwise(cells)} == {1}


def times_options(table: Table, column: int, unit: str = "", step: float | None = None) -> ReadOptions:
    """Return the options that make a column the times."""
    named = ReadOptions(time_column=table.unmistakable(column) + (f"={unit}" if unit else ""))
    return named | (_uneven(table, column, unit, step) or NO_OPTIONS)


def unit_of_steps(step: float, sample_time: float) -> str:
    """Return the unit in which a step of unitless times is nearest to a sample time, s."""
    return min(("s", "ms", "us", "ns"), key=lambda unit: abs(math.log(step / UNITS[unit].denominator / sample_time)))


def _uneven(table: Table, column: int, unit: str = "", step: float | None = None) -> ReadOptions | None:
    """Return the options with which a column can be the times; empty if its clock is even; None if it cannot."""
    own = table.units[column]
    if UNITS[own].si not in ("", "s") or (own and unit and own != unit):
        return None
    try:
        times = with_times(table, column, own or unit).si([column])[0]
    except DataError:
        return None
    try:
        even_pieces(times, table.where, allow_gaps=False, stated=step)
    except DataError:
        return resampling_options(times, step)
    return NO_OPTIONS


def with_times(table: Table, column: int, unit: str) -> Table:
    """Return a table that reads a column as times."""
    if not unit and _ONE_NUMBER.fullmatch(table.headers[column]):
        unit = CLOCK
    order = unit if unit in ORDERS else ""
    known = "s" if order or unit == CLOCK else unit or "s"
    units = tuple(known if k == column else own for k, own in enumerate(table.units))
    scale = time_scale(table.texts(column), unit)
    # A file written by deatwin reads back unchanged, whatever its clock.
    if scale and scale.unit and (table.declared.signals or table.headers[column] == USUAL_TIMES):
        scale = None
    if scale and scale.texts and scale.began is None:
        _require_no_skipped_days(table, column)
    if scale and scale.texts and scale.began is None and not scale.order:
        either = [ReadOptions(time_column=f"{table.unmistakable(column)}={kind}") for kind in (CLOCK, "s")]
        raise DataError(
            f'{table.path}: the times in the column "{table.shown(column)}" may be times of day, hours, minutes and seconds in '
            f"one number, or seconds; state it: {either[0]} or {either[1]}",
            either[0],
        )
    if order and not scale:
        raise DataError(f'{table.path}: the column "{table.shown(column)}" holds no dates; remove "={order}"')
    if scale and not scale.order and len({re.split("[T ,]", text.strip())[0] for text in table.texts(column)}) > 1:
        orders = date_orders(table.texts(column))
        either = [ReadOptions(time_column=f"{table.unmistakable(column)}={order}") for order in orders]
        words = [{"d": "the day", "m": "the month", "y": "the year"}[order[0]] for order in orders]
        first = f"{', '.join(words[:-1])} or {words[-1]}"
        raise DataError(
            f'{table.path}: the dates in the column "{table.shown(column)}" may have {first} first, and '
            f"none of them shows which; state the order: {' or '.join(map(str, either))}",
            either[0],
        )
    return replace(table, units=units, scales={column: scale} if scale else {})


def _require_no_skipped_days(table: Table, column: int) -> None:
    """Refuse times of day beside a column of dates, if a date changes where the times do not pass as many midnights."""
    dated = [k for k in range(len(table.headers)) if k != column and is_date(next(iter(table.texts(k)), "").strip())]
    for beside in dated:
        dates = list(table.texts(beside))
        if len(set(dates)) < 2:
            continue
        try:
            days = [time // 86400 for time in day_seconds(table.texts(column))]
        except ValueError:  # the error of the bad cell comes later
            return
        orders = date_orders(dates)
        for k in np.flatnonzero([b != a for a, b in pairwise(dates)]) + 1:
            try:
                before, after = (moment(cell, orders[0]) for cell in dates[k - 1 : k + 1])
            except ValueError:
                continue
            passed = (after.date() - before.date()).days
            passed = passed if len(orders) == 1 else int(passed != 0)  # if ambiguous, each change is one day
            if before.tzinfo is after.tzinfo is None and days[k] - days[k - 1] != passed:
                raise DataError(
                    f'{table.where(int(k))}: in the column "{table.shown(beside)}" {clipped(dates[k])} follows '
                    f'{clipped(dates[k - 1])}, but the times in the column "{table.shown(column)}" do not pass as '
                    "many midnights there; write date and time in one column"
                )


def require_unit(table: Table, column: int, times: Floats) -> None:
    """Refuse times in an unknown unit, or in none if they may be days of a calendar: as many as in one of `_CALENDARS`, in
    steps that would be very short as seconds. A time of day is a part of a day, long after midnight; neither step nor
    rate is a round number unless the times are counted in days.
    """
    place = f'{table.path}: the times in the column "{table.shown(column)}"'
    options = {unit: ReadOptions(time_column=f"{table.unmistakable(column)}={unit}") for unit in TIME_UNITS}
    words = _IN_WORDS.fullmatch(table.headers[column])
    if said := "" if table.units[column] else table.own_unit(column) or (words[1] if words else ""):
        rows = bool((np.diff(times) == 1.0).all())
        counted = "; if the column counts the samples, state the sample time: --dt SECONDS" if rows else ""
        like = options.get(said.lower(), NO_OPTIONS)  # only capitals differ; any other unit is the user's to state
        state = f"state one, such as {like or options['s']}"
        if re.search(r"\d", said):  # 0.1 ms
            state = f"convert the times to one, then state it: {options['s']}"
        raise DataError(
            f'{place} are said to be in "{clipped(said)}", which is not a known unit of time; {state} '
            f"(known are {', '.join(TIME_UNITS)}){counted}",
            like,
        )
    steps = np.diff(times)
    dated = any(a <= times[0] < b for a, b in _CALENDARS)
    step = float(times[-1] - times[0]) / max(steps.size, 1)
    late = step * steps.size < times[0] < times[-1] < 1.0
    of_day = late and _is_round(step * UNITS["day"].numerator) and not (_is_round(step) or _is_round(1.0 / step))
    if steps.size and 0.0 < np.median(steps) < _SHORT and (dated or of_day):
        raise DataError(
            f"{place} may be days of a calendar, as spreadsheets count them, or seconds; state it: "
            f"{options['day']} or {options['s']}",
            options["day"],
        )


def _is_round(step: float) -> bool:
    """Return whether a positive number has at most two digits, but for rounding."""
    return abs(step / float(f"{step:.1e}") - 1.0) < _ROUNDED


def unpadded(table: Table, column: int) -> str:
    """Return the fault of times whose fractions lack zeros in front, as in 1.5 for 1.005; empty if they increase as such."""
    cells = [cell.strip() for cell in table.texts(column)]
    parts = [re.fullmatch(r"(.*\d)\.(\d{1,6})", cell) for cell in cells]
    digits = max((len(part[2]) for part in parts if part), default=0)
    padded = [f"{part[1]}.{part[2]:0>{digits}}" for part in parts if part]
    short = next((k for k, part in enumerate(parts) if part and int(part[2]) and len(part[2]) < digits), None)
    if short is None or len(padded) < len(cells):
        return ""
    scale = time_scale(cells, table.units[column])
    try:
        times = np.array(scale.seconds(padded) if scale else list(map(float, padded)))
    except ValueError:
        return ""
    if (np.diff(times) <= 0.0).any():
        return ""
    return (
        f'{table.where(short)}, column "{table.shown(column)}": the fractions lack zeros in front, because as written the '
        f'times go back; write "{clipped(cells[short])}" as "{clipped(padded[short])}", and so on'
    )


def no_times(table: Table, taken: set[int]) -> DataError:
    """Return an error for a file without information on its times."""
    if table.rate and not likely_times(table, taken):
        said, step = table.rate
        offers = ReadOptions(dt=float(f"{step:.12g}"))
        return DataError(
            f'{table.path}: there is no column of times, but the file says "{clipped(said)}"; if one row follows the other at '
            f"this rate, state it: {offers}, in Python dt={offers.dt:g}; else name the column of times: --time-column NAME",
            offers,
        )
    if table.nameless:
        others = likely_times(table, taken)
        offers = times_options(table, others[0]) if others else NO_OPTIONS
        return DataError(
            f"{table.path}, row {table.row(0)}: there is no header, so it is unknown which column holds the times; name it by its "
            f"position ({offers or '--time-column POSITION'}), or give the sample time in seconds: --dt, in Python dt",
            offers,
        )
    likely = likely_times(table, taken)
    offers = times_options(table, likely[0]) if likely and _equal(table, likely) else NO_OPTIONS
    for column in set(range(len(table.names))) - taken:
        if _plain(table.names[column]) in TIME_NAMES and _is_constant(table, column):
            return DataError(
                f'{table.path}: the column "{table.shown(column)}" holds the same time in all rows; name the column of '
                f"times ({offers or '--time-column NAME'}), or give the sample time in seconds: --dt, in Python dt",
                offers,
            )
    advice = (
        f'rename the column of times to "{USUAL_TIMES}", or write a unit of time, such as (s), after or below its name; '
        f"or name this column with {offers or '--time-column NAME'}; "
        "if the file holds no times, give the sample time in seconds: --dt, in Python dt"
    )
    near = table.near(USUAL_TIMES, lambda column: column in likely)
    return DataError(
        f'{table.path}: no column "{USUAL_TIMES}"; the file has {table.listing()}{near} ({advice})', offers
    )
