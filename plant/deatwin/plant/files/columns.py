"""Which column of a table is the time, the input, the output and the further channels."""

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.units import UNITS, split_unit
from deatwin.plant.intake import clipped

__all__ = ["COLUMNS", "data_columns", "extra_columns", "no_times", "time_column", "usual_unit"]

# The columns of a recording as deatwin writes them, by the name that each has inside.
COLUMNS = {
    "time": "time_s",
    "command": "command_V",
    "displacement": "displacement_mm",
    "film_voltage": "film_voltage_V",
    "current": "current_uA",
    "temperature": "temperature_C",
    "force": "force_N",
}
_USUAL = {"input": "command", "output": "displacement"}
_EXTRAS = ("film_voltage", "current", "temperature", "force")
# A column that would be passed over is refused as a misspelling from this likeness on.
_MISSPELT = 0.85
_TIME_NAMES = ("time", "t", "zeit", "temps", "时间")


def data_columns(table: Table, role: str, wanted: str | None) -> tuple[int, ...]:
    """Return the columns of the inputs or the outputs.

    Parameters
    ----------
    table : Table
    role : str
        ``input`` or ``output``.
    wanted : str, optional
        The column that the user asked for, by header or by place. Else those that the file declares count, else
        the usual one, ``command`` or ``displacement``.

    Returns
    -------
    tuple of int
        Counted from 0; one, unless the file declares more or none.

    Raises
    ------
    DataError
        If there is no such column, or the usual one has a unit of another kind.
    """
    if wanted is not None:
        return (table.column(wanted),)
    if table.declared.signals:
        return table.columns_of(role)
    name = _USUAL[role]
    column = _usual_column(table, name)
    if column is None:
        raise _no_column(table, name, f"rename it, or name the one to use: --{role}-column")
    return (column,)


def usual_unit(name: str) -> str:
    """Return the SI unit of a signal with one of deatwin's own names, an empty text for others.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Examples
    --------
    >>> usual_unit("temperature"), usual_unit("humidity")
    ('K', '')
    """
    return UNITS[split_unit(COLUMNS[name])[1]].si if name in COLUMNS else ""


def time_column(table: Table, taken: set[int]) -> int | None:
    """Return the column of the times: the one with the usual name, else the first with a unit of time.

    Parameters
    ----------
    table : Table
    taken : set of int
        Columns that are something else.

    Returns
    -------
    int or None
        Counted from 0; None where there is none.
    """
    free = [column for column in range(len(table.headers)) if column not in taken]
    timed = [column for column in free if UNITS[table.units[column]].si == "s"]
    # A column named time without a unit is in seconds.
    named = [
        column
        for column in free
        if table.names[column].lower() in _TIME_NAMES and (column in timed or not table.units[column])
    ]
    return next(iter(named or timed), None)


def no_times(table: Table) -> DataError:
    """Return the error of a file that says nothing about its times.

    Parameters
    ----------
    table : Table

    Returns
    -------
    DataError
    """
    advice = (
        "the times need this name, or a unit: (s) behind or below their name; "
        "for evenly sampled values without times give the sample time in seconds: --dt, in Python dt"
    )
    return _no_column(table, "time", advice)


def extra_columns(table: Table, taken: set[int]) -> list[int]:
    """Return the columns of the further channels: those that the file declares, else those with usual names.

    Parameters
    ----------
    table : Table
    taken : set of int
        Columns that are the time, the input or the output.

    Returns
    -------
    list of int
        Counted from 0.

    Raises
    ------
    DataError
        If one has a unit of another kind, or a column that is passed over has nearly such a name.
    """
    if table.declared.signals:
        return [column for column in table.columns_of("extra") if column not in taken]
    found = {name: column for name in _EXTRAS if (column := _usual_column(table, name)) is not None}
    absent = [COLUMNS[name] for name in _EXTRAS if name not in found]
    for column, header in enumerate(table.headers):
        if column in taken or table.names[column] in COLUMNS:
            continue
        if hint := nearest(header, absent, likeness=_MISSPELT):
            raise DataError(f'{table.path}: unknown column "{clipped(header)}"{hint}')
    return [column for column in found.values() if column not in taken]


def _usual_column(table: Table, name: str) -> int | None:
    """Return the column with one of deatwin's own names and a unit of the right kind, or None."""
    if name not in table.names:
        return None
    column = table.column(name)
    unit, right = table.units[column], split_unit(COLUMNS[name])[1]
    if UNITS[unit].si != UNITS[right].si:
        raise DataError(
            f'{table.path}: the column "{table.shown(column)}" has the unit {unit or "(none)"}; '
            f'it must be one like {right}, as in "{COLUMNS[name]}"'
        )
    return column


def _no_column(table: Table, name: str, advice: str) -> DataError:
    """Return the error of a column that is missing."""
    usual = COLUMNS[name]
    return DataError(
        f'{table.path}: no column "{usual}"; the file has {table.listing()}'
        f"{nearest(usual, table.headers)} ({advice})"
    )
