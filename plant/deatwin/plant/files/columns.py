"""Find the columns of a table that hold the input, the output and the further channels."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import compress, islice

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.csvcells import is_number
from deatwin.plant.files.csvtext import header_line
from deatwin.plant.files.dates import is_date
from deatwin.plant.files.formats.table import Table, is_place
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.timecolumns import holds_times, likely_times, numbers_rows, time_column, times_options
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.files.usual import COLUMNS, LIKE_TIMES
from deatwin.plant.files.wanted import in_units, require_known_units, split_stated, units_like
from deatwin.plant.readings import Reading
from deatwin.plant.readoptions import NO_OPTIONS
from deatwin.plant.safe_read import clipped

_USUAL = {"input": "command", "output": "displacement"}
_ONE_FILE = "input and output must be columns of one file"
_EXTRAS = ("film_voltage", "current", "capacitance", "temperature", "force")
# Likeness to a usual header from which an unused column is refused as a misspelling.
_MISSPELT = 0.85
_FIRST = 1000  # Number of values by which columns are compared
_CHANNELS = 50  # Largest number of channels in a table with one row for each reading


def chosen_columns(
    table: Table, asked: Mapping[str, str | None], units: Mapping[str, str | None]
) -> dict[str, tuple[int, ...]]:
    """Return the columns of the inputs and the outputs."""
    if table.nameless:
        _require_places(table, asked)
    known = {role: _quietly(table, role, wanted) for role, wanted in asked.items()}
    chosen: dict[str, tuple[int, ...]] = {}
    for role in ("input", "output"):
        if role not in asked:
            chosen[role] = ()
            continue
        others = {column for other, columns in known.items() if other != role for column in columns}
        others |= {k for other, wanted in asked.items() if other != role for k in _headed(table, wanted)}
        chosen[role] = data_columns(table, role, asked[role], others, units.get(role))
    seen: dict[int, str] = {}
    times = asked.get("time")
    for role, columns in {**chosen, "time": known.get("time", ()) if times else ()}.items():
        for column in columns:
            if column in seen:
                raise _twice(table, column, (seen[column], role), asked, units)
            seen[column] = role
    return chosen


def require_wide(table: Table) -> None:
    """Refuse a table with one row for each reading of each channel, as databases of time series write it."""
    for column in range(len(table.headers)):
        cells = list(table.texts(column))
        often = Counter(cells)
        if (
            1 < len(often) <= _CHANNELS
            and 1 < min(often.values()) == max(often.values())
            and all(re.search(r"[^\W\d_]", cell) and not is_date(cell) and not is_number(cell) for cell in often)
            and len(_varying(table, [cell == cells[0] for cell in cells])) < 2
        ):
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" seems to name the channel of each row; give each channel a '
                "column of its own, in Python with DataFrame.pivot of pandas"
            )


def _varying(table: Table, rows: list[bool]) -> list[int]:
    """Return the columns of numbers that vary within some rows, without the times."""
    signals = [k for k, name in enumerate(table.names) if not LIKE_TIMES.search(name) and table.unit(k).si != "s"]
    return [k for k in signals if works(table, k) and len(set(compress(table.texts(k), rows))) > 1]


def _quietly(table: Table, role: str, wanted: str | None) -> tuple[int, ...]:
    """Return the columns for a role; empty if they cannot be determined."""
    try:
        if role == "time":
            column, _ = time_column(table, set(), wanted)
            return () if column is None else (column,)
        return data_columns(table, role, wanted)
    except DataError:
        return ()


def _headed(table: Table, wanted: str | None) -> list[int]:
    """Return the columns that the user named for a role, suitable or not."""
    headers = {wanted, (wanted or "").rpartition("=")[0]}
    return [k for k, header in enumerate(table.headers) if header in headers or table.names[k] in headers]


def _twice(
    table: Table, column: int, roles: tuple[str, str], asked: Mapping[str, str | None], units: Mapping[str, str | None]
) -> DataError:
    """Return an error for a column with two roles, which offers another column for a role that the user did not set."""
    said = [f"named as {role}" if asked.get(role) else f"the usual {role}" for role in roles]
    free = [role for role in roles if not asked.get(role)] or [roles[1]]
    role, busy = free[0], {column, *_others(table, free[0], asked)}
    require_wide(table)
    fits = partial(holds_times, table) if role == "time" else partial(works, table, unit=units.get(role))
    free_columns = [k for k in range(len(table.headers)) if k not in busy]
    other = next((k for k in free_columns if fits(k) and (role == "time" or not numbers_rows(table, k))), None)
    way = NO_OPTIONS
    if other is not None:
        named = way.with_column(role, table.unmistakable(other))
        way = times_options(table, other) if role == "time" else named
    hint = f", for example {way}" if way else f": --{role}-column"
    if not free_columns:
        hint = f", which no other column of the file can be: {_ONE_FILE}"
    return DataError(
        f'{table.path}: the column "{table.shown(column)}" is {said[0]} and also {said[1]}; name another one for the '
        f"{role}{hint}",
        way,
    )


def _others(table: Table, role: str, asked: Mapping[str, str | None]) -> set[int]:
    """Return the columns of all other roles."""
    return {k for other, wanted in asked.items() if other != role for k in _quietly(table, other, wanted)}


def works(table: Table, column: int, unit: str | None = None) -> bool:
    """Return whether a column can be an input or output: numbers, with a known unit or none."""
    try:
        read = in_units(table, {} if unit is None else {column: unit})
        require_known_units(read, [column])
        read.si([column])
    except DataError:
        return False
    return True


def alike(table: Table, one: int, other: int) -> bool:
    """Return whether two columns begin with the same values, as do the times that are written before each channel."""
    return one == other or list(islice(table.texts(one), _FIRST)) == list(islice(table.texts(other), _FIRST))


def data_columns(
    table: Table, role: str, wanted: str | None, busy: Collection[int] = frozenset(), unit: str | None = None
) -> tuple[int, ...]:
    """Return the columns of the inputs or the outputs."""

    def offered(column: int) -> bool:
        return column not in busy and works(table, column, unit)

    if wanted is not None:
        return (table.column(wanted, offered),)
    if table.declared.signals:
        return table.columns_of(role)
    name = _USUAL[role]
    column = _usual_column(table, name)
    if column is None:
        advice = f"rename that column, or name the {role} column with --{role}-column"
        if set(range(len(table.headers))) <= set(busy):
            advice = f"no other column can be the {role}: {_ONE_FILE}"
        raise _no_column(table, name, advice, offered)
    return (column,)


def _require_places(table: Table, asked: Mapping[str, str | None]) -> None:
    """Raise an error if the user names no columns by position for a file without a header."""
    places = {role: (wanted or "").partition("=")[0] for role, wanted in asked.items()}
    missing = [role for role in ("input", "output") if role in asked and not places[role]]
    wrong = [name for name in places.values() if name and not is_place(name)]
    if wrong or missing:
        fault = (
            f'no column is called "{clipped(wrong[0])}"' if wrong else f"it is unknown which column is the {missing[0]}"
        )
        raise _no_header(table, fault, asked)


def _no_header(table: Table, fault: str, roles: Collection[str]) -> DataError:
    """Return an error for a file without a header, with a way to name the columns for these roles."""
    columns = range(len(table.headers))
    times = next(iter(likely_times(table, set())), None)
    places = [f"#{k + 1}" for k in columns if not (times is not None and alike(table, k, times)) and works(table, k)]
    if len(columns) - (times is not None) < len({"input", "output"}.intersection(roles)):
        raise DataError(f"{table.path}: besides its times, the file holds only one signal; {_ONE_FILE}")
    pairs = [pair for pair in zip(("input", "output"), places, strict=False) if pair[0] in roles]
    said = NO_OPTIONS
    for role, place in pairs:
        said = said.with_column(role, place)
    timed = NO_OPTIONS if times is None else times_options(table, times)
    clock = f"{timed} (or --dt SECONDS)" if timed else "--dt SECONDS"
    return DataError(
        f"{table.path}, row {table.row(0)}: there is no header, so {fault}; name the columns by their positions, for example "
        f"{f'{said} {clock}'.strip()}, or put a header above: {header_line(len(table.headers), table.delimiter, times)}",
        said | timed,
    )


def extra_columns(table: Table, taken: set[int]) -> list[int]:
    """Return the columns of the further channels: as declared in the file, else by their usual names."""
    if table.declared.signals:
        return [column for column in table.columns_of("extra") if column not in taken]
    found = {name: column for name in _EXTRAS if (column := _usual_column(table, name, taken)) is not None}
    # If the user had to name columns, the file does not use the usual headers, and one like them is no misspelling.
    if all(table.names[column] in COLUMNS for column in taken):
        absent = [COLUMNS[name] for name in _EXTRAS if name not in found]
        for column, header in enumerate(table.headers):
            if column in taken or table.names[column] in COLUMNS:
                continue
            if hint := nearest(header, absent, likeness=_MISSPELT):
                raise DataError(f'{table.path}: unknown column "{clipped(header)}"{hint}')
    return list(found.values())


def with_readings(table: Table, readings: Iterable[Reading], taken: set[int]) -> tuple[Table, dict[int, Reading]]:
    """Return the table with the columns of further readings in their units, and these columns."""
    found: dict[int, Reading] = {}
    names, units = list(table.names), list(table.units)
    for reading in readings:
        name, unit = split_stated(table, reading.column)
        column = table.column(name) if name else _own_column(table, reading.name, taken)
        if name and column in taken:
            raise DataError(
                f'{table.path}: the reading "{reading.name}" names the column "{table.shown(column)}", which is already the '
                "input, the output or the time; name another column for this reading"
            )
        if column is None or column in taken:
            continue
        found[column], names[column] = reading, reading.name
        units[column] = find_unit(unit) if unit else units[column]
        if reading.unit and not (unit or table.own_unit(column)):
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" of the reading "{reading.name}" gives no unit; state '
                f'it after the name of the column in the rig file: "{table.unmistakable(column)}=UNIT", with one of '
                f"{', '.join(units_like(reading.unit))}"
            )
    table = replace(table, names=tuple(names), units=tuple(units))
    return in_units(table, {column: reading.unit for column, reading in found.items() if reading.unit}), found


def _own_column(table: Table, name: str, taken: set[int]) -> int | None:
    """Return the column of a reading under its own name, or None."""
    if name in COLUMNS:
        return _usual_column(table, name, taken)
    return next((k for k in range(len(table.names)) if name in (table.headers[k], table.names[k])), None)


def _usual_column(table: Table, name: str, taken: Collection[int] = frozenset()) -> int | None:
    """Return the column with one of deatwin's own names and a suitable unit; None if there is none."""
    usual, right = COLUMNS[name], split_unit(COLUMNS[name])[1]
    named = [
        column
        for column in range(len(table.names))
        if table.names[column] == name and (table.units[column] or not table.own_unit(column))
    ]
    if set(taken).intersection(named):
        return None  # a column of this quantity already has a role
    fitting = [column for column in named if UNITS[table.units[column]].si == UNITS[right].si]
    exact = [column for column in fitting if table.headers[column] == usual]
    best = exact if len(exact) == 1 else fitting
    if len(best) == 1:
        return best[0]
    if not named or (taken and len(named) > 1):
        return None
    if len(named) > 1:
        return table.column(name)  # raises the error that says how to name one
    unit = table.units[named[0]]
    raise DataError(
        f'{table.path}: the column "{table.shown(named[0])}" has the unit {unit or "(none)"}, '
        f'but the {name} must be in {right} or a multiple of it, as in "{usual}"'
    )


def _no_column(table: Table, name: str, advice: str, works: Callable[[int], bool]) -> DataError:
    """Return an error for a missing column, which may offer another one."""
    require_wide(table)
    usual = COLUMNS[name]
    return DataError(
        f'{table.path}: no column "{usual}"; the file has {table.listing()}{table.near(usual, works)} ({advice})'
    )
