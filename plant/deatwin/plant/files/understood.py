"""Describe how a file is understood: role and unit of each column with reasons, and options that read it."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from deatwin.plant.errors import DataError
from deatwin.plant.files.columns import alike, chosen_columns, data_columns, extra_columns, with_readings, works
from deatwin.plant.files.dates import is_date
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.recordings import recordings_of_table, table_of_file
from deatwin.plant.files.timecolumns import counts_by_one, likely_times, numbers_rows, time_column
from deatwin.plant.files.usual import LIKE_TIMES
from deatwin.plant.files.wanted import split_stated, with_stated_units
from deatwin.plant.readings import Reading
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime

_REPAIRS = 7  # Largest number of rounds; there are six options, so that more rounds add nothing
_LIKE_NUMBER = re.compile(r"[-+]?\d?[\d.,'’\s]*\d([eE][-+]?\d+)?( ?[^\W\d]{1,3})?")  # perhaps with marks and a unit
_WORD = re.compile(r"(?![xX]\d\d)(?<!\d)(?:[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[^\W\d_]+)")  # x1000 and 10X are factors
_USUAL_WORDS = {
    "input": "u uin vin input in cmd command control excitation drive voltage volt v hv reference ref setpoint target pwm "
    "eingang soll stell spannung strom current torque",
    "output": "y out output displacement disp position pos weg x measured response encoder angle speed velocity level "
    "ausgang ist auslenkung laser distance abstand deflection temperature",
}
_WORDS = {role: tuple(words.split()) for role, words in _USUAL_WORDS.items()}
"""Common names of inputs and outputs, the surest first. They only rank guesses, which are reported as guesses."""
_UNITS = {"input": ("V", "A"), "output": ("m", "rad", "N")}
"""Usual SI units of inputs and outputs, which rank columns without a common name."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a file, with its interpretation."""

    place: int  # Position in the file, from 1
    header: str
    role: str  # ``input``, ``output``, ``time``, ``extra``, ``reading``; empty if the column is passed over
    unit: str  # Unit given by the file or an option; empty if neither gives one
    si: str  # Unit of its values in the recording
    how: str  # Origin of its role
    numbers: bool  # True if it can be an input or an output


@dataclass(frozen=True, kw_only=True, eq=False)
class Understood:
    """A file, read as requested or with further options."""

    path: str
    columns: tuple[Column, ...] = ()
    recordings: tuple[Recording, ...] = ()  # Empty if no options were found that read the file
    refused: str = ""  # Error that ends a command without the further options
    remaining: str = ""  # Error that ends a command with all options that were found
    asked: ReadOptions = NO_OPTIONS
    further: ReadOptions = NO_OPTIONS  # Options that are needed besides
    placeholders: tuple[str, ...] = ()  # Options whose values only the user knows

    @property
    def options(self) -> tuple[str, ...]:
        """Words of a command that reads the file."""
        return (*(self.asked | self.further).words, *self.placeholders)

    def with_column(self, role: str, place: int) -> tuple[str, ...]:
        """Return the words of a command that reads another column, by position from 1, as ``input`` or ``output``."""
        return (self.asked | self.further).with_column(role, f"#{place}").words


def understand(
    path: str | Path,
    asked: ReadOptions = NO_OPTIONS,
    readings: Sequence[Reading] = (),
    units: tuple[str, str] | None = None,
) -> Understood:
    """Read a file as asked or, if that is refused, with options that work.

    `readings` are the rig's further ones, `units` those of its input and output, in SI.
    """
    found = Understood(path=str(path), asked=asked)
    try:
        table = table_of_file(path)
    except DataError as error:
        return replace(found, refused=str(error))
    for _ in range(_REPAIRS):
        try:
            read = _read(table, asked | found.further)
        except DataError as error:
            more = _repair(table, error.offers, asked | found.further, units)
            found = replace(found, refused=found.refused or str(error), further=found.further | more)
            if not more:
                return _unread(table, found, str(error))
        else:
            return replace(found, columns=_columns(table, found, readings), recordings=read)
    return _unread(table, found, found.refused)


def _unread(table: Table, found: Understood, remaining: str) -> Understood:
    """Describe a file that cannot be read, unless only its sample time is missing."""
    timed = (k for k in likely_times(table, set()) if LIKE_TIMES.search(table.names[k]) or table.unit(k).si == "s")
    if found.asked.dt is None and next(timed, None) is None:
        try:
            _read(table, replace(found.asked | found.further, dt=1.0))
        except DataError:
            pass
        else:
            found = replace(found, placeholders=("--dt", "SECONDS"))
            return replace(found, columns=_columns(table, found))
    words = shlex.join(found.further.words)
    remaining = f"with {words}: {remaining}" if words and remaining != found.refused else ""
    return replace(found, columns=_columns(table, found), further=NO_OPTIONS, remaining=remaining)


def _read(table: Table, options: ReadOptions) -> tuple[Recording, ...]:
    return recordings_of_table(
        table,
        _roles(options),
        {"input": None, "output": None},
        allow_gaps=options.allow_gaps,
        dt=options.dt,
        resample=options.resample,
        reading=ReadingTime.END_OF_HOLD,
        rig=None,
    )


def _roles(options: ReadOptions) -> dict[str, str | None]:
    return {"input": options.input_column, "output": options.output_column, "time": options.time_column}


def _repair(table: Table, offered: ReadOptions, options: ReadOptions, wanted: tuple[str, str] | None) -> ReadOptions:
    """Return the options that an error suggests, else guessed columns, if the user has not set them."""
    new = offered.without(*options.given)
    if new.time_column:  # replaces a sample time; the next round finds what the column itself needs
        new = new.without("dt", "resample")
    return new or _guessed(table, options, wanted)


def _guessed(table: Table, options: ReadOptions, wanted: tuple[str, str] | None) -> ReadOptions:
    """Return columns for roles without a matching header.

    They are guessed from the units that are wanted, if any, then from common names, else from units and order.
    """
    bare, asked = with_stated_units(table, _roles(options))
    known: dict[str, int] = {}
    for role in ("input", "output"):
        try:
            (known[role],) = data_columns(bare, role, asked[role])
        except (DataError, ValueError):
            if asked[role]:
                return NO_OPTIONS  # a column named by the user is not replaced
    times = _times(table, set(known.values()), asked["time"])
    left = [k for k in range(len(table.headers)) if k not in times and k not in known.values()]
    left = [k for k in left if table.unit(k).si != "s"]  # a part of the time, such as its milliseconds
    left = [k for k in left if not any(alike(table, k, clock) for clock in times)]
    # A column with a single bad cell is still a candidate; the next error names that cell.
    free = [k for k in left if works(table, k) or _mostly_numbers(table, k)]
    free = [k for k in free if not _counts(table, k)] or [k for k in free if not numbers_rows(table, k)]
    if len(known) + len(free) < 2:  # the next error names a cell that is no number
        free += [k for k in left if k not in free and table.unit(k).si]
    found = NO_OPTIONS
    for role in (role for role in ("input", "output") if role not in known and free):
        other = _WORDS["output" if role == "input" else "input"]
        units = _UNITS[role]
        best = min(
            free,
            key=lambda k: (
                _unlike(table.unit(k).si, wanted, role),
                _rank(table, k, _WORDS[role]),
                (*units, table.unit(k).si).index(table.unit(k).si),
                -_rank(table, k, other),
                k,
            ),
        )
        free.remove(best)
        found = found.with_column(role, table.unmistakable(best))
    return found


def _unlike(unit: str, wanted: tuple[str, str] | None, role: str) -> int:
    """Return 0 for a unit that is wanted for a role, 2 for the one that is wanted for the other role, and 1 for others."""
    if wanted is None:
        return 1
    own, other = wanted if role == "input" else wanted[::-1]
    return 0 if unit == own or (own == "1" and not unit) else 2 if unit == other else 1


def _mostly_numbers(table: Table, column: int) -> bool:
    cells = [cell for cell in table.texts(column) if cell.strip() and not is_date(cell.strip())]
    return 2 * sum(map(bool, map(_LIKE_NUMBER.fullmatch, cells))) > len(cells)


def _counts(table: Table, column: int) -> bool:
    """Return whether a column is constant or numbers the rows, so that it is no signal."""
    cells = list(table.texts(column))
    return len(set(cells)) == 1 or counts_by_one(cells)


def _rank(table: Table, column: int, words: tuple[str, ...]) -> int:
    """Return the position of a header's first word in a list; the length of the list if it is not there."""
    said = [word.lower() for word in _WORD.findall(table.names[column])]
    return min((words.index(word) for word in said if word in words), default=len(words))


def _times(table: Table, taken: set[int], wanted: str | None) -> set[int]:
    """Return the columns that hold or may hold the times."""
    try:
        column, _ = time_column(table, taken, wanted)
    except DataError:
        column = None
    return set(likely_times(table, taken)) if column is None else {column}


def _columns(table: Table, found: Understood, readings: Sequence[Reading] = ()) -> tuple[Column, ...]:
    """Return all columns with their interpretations."""
    roles = _roles(found.asked | found.further)
    try:
        read, bare = with_stated_units(table, roles)
        chosen = chosen_columns(read, bare, {"input": None, "output": None})
        taken = {column for columns in chosen.values() for column in columns}
        times, unit = time_column(read, taken, roles["time"], needed=False)
        extras = extra_columns(read, {*taken, *([] if times is None else [times])})
    except DataError:
        read, chosen, times, unit, extras = table, {}, None, "", []
    times = None if found.placeholders else times
    others = {*(column for columns in chosen.values() for column in columns), *([] if times is None else [times])}
    read, further = with_readings(read, readings, others)
    role_of = {column: role for role, columns in chosen.items() for column in columns}
    role_of |= (
        dict.fromkeys(extras, "extra") | dict.fromkeys(further, "reading") | ({} if times is None else {times: "time"})
    )
    made = []
    for k, header in enumerate(table.headers):
        role = role_of.get(k, "")
        own = unit if k == times else read.own_unit(k)
        si = "s" if k == times else read.unit(k).si
        how = _how(table, header, role, found) if role else "passed over"
        numbers = role in ("input", "output", "extra", "reading") or works(table, k)
        made.append(Column(place=k + 1, header=header, role=role, unit=own, si=si, how=how, numbers=numbers))
    return tuple(made)


def _how(table: Table, header: str, role: str, found: Understood) -> str:
    """Say why a column has its role and, if an option gave it, its unit."""
    if role == "reading":
        return "by the rig"
    key = f"{role}_column"
    if value := _roles(found.asked | found.further).get(role):
        said = "guessed" if key in found.further.given else f"named by --{role}-column"
        return f"{said}, unit by the option" if split_stated(table, value)[1] else said
    if role != "time" and table.declared.signals:
        return "declared by the file"
    return "by its values" if table.nameless or not header else "by its header"
