"""Which column of a table is the time, the input, the output and the further channels."""

from deatwin.plant.csvtable import CsvTable
from deatwin.plant.errors import DataError, nearest
from deatwin.plant.units import UNITS, split_unit

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
_EXTRAS = ("film_voltage", "current", "temperature", "force")
# A column that would be passed over is refused as a misspelling from this likeness on.
_MISSPELT = 0.85
_TIME_NAMES = ("time", "t", "zeit", "temps", "时间")


def data_column(table: CsvTable, name: str, wanted: str | None) -> int:
    """Return the column of the input or the output.

    Parameters
    ----------
    table : CsvTable
    name : str
        Its usual name, ``command`` or ``displacement``.
    wanted : str, optional
        The column that the user asked for, by header or by place.

    Returns
    -------
    int
        Counted from 0.

    Raises
    ------
    DataError
        If there is no such column, or the usual one has a unit of another kind.
    """
    column = _usual_column(table, name) if wanted is None else table.column(wanted)
    if column is None:
        role = "input" if name == "command" else "output"
        raise _no_column(table, name, f"rename it, or name the one to use: --{role}-column")
    return column


def time_column(table: CsvTable, taken: set[int]) -> int:
    """Return the column of the times: the one with the usual name, else the first with a unit of time.

    Parameters
    ----------
    table : CsvTable
    taken : set of int
        Columns that are something else.

    Returns
    -------
    int
        Counted from 0.

    Raises
    ------
    DataError
        If there is none.
    """
    free = [column for column in range(len(table.headers)) if column not in taken]
    timed = [column for column in free if UNITS[table.units[column]].si == "s"]
    # A column named time without a unit is in seconds.
    named = [
        column
        for column in free
        if table.names[column].lower() in _TIME_NAMES and (column in timed or not table.units[column])
    ]
    if not named and not timed:
        raise _no_column(table, "time", "the times need this name, or a unit: (s) behind or below their name")
    return (named or timed)[0]


def extra_columns(table: CsvTable, taken: set[int]) -> dict[str, int]:
    """Return the columns of the further channels, by their names inside.

    Parameters
    ----------
    table : CsvTable
    taken : set of int
        Columns that are the time, the input or the output.

    Returns
    -------
    dict of str to int

    Raises
    ------
    DataError
        If one has a unit of another kind, or a column that is passed over has nearly such a name.
    """
    found = {name: column for name in _EXTRAS if (column := _usual_column(table, name)) is not None}
    absent = [COLUMNS[name] for name in _EXTRAS if name not in found]
    for column, header in enumerate(table.headers):
        if column in taken or table.names[column] in COLUMNS:
            continue
        if hint := nearest(header, absent, likeness=_MISSPELT):
            raise DataError(f'{table.path}: unknown column "{header}"{hint}')
    return {name: column for name, column in found.items() if column not in taken}


def _usual_column(table: CsvTable, name: str) -> int | None:
    """Return the column with one of deatwin's own names and a unit of the right kind, or None."""
    if name not in table.names:
        return None
    column = table.column(name)
    unit, right = table.units[column], split_unit(COLUMNS[name])[1]
    if UNITS[unit].si != UNITS[right].si:
        raise DataError(
            f'{table.path}: the column "{table.headers[column]}" has the unit {unit or "(none)"}; '
            f'it must be one like {right}, as in "{COLUMNS[name]}"'
        )
    return column


def _no_column(table: CsvTable, name: str, advice: str) -> DataError:
    """Return the error of a column that is missing."""
    usual = COLUMNS[name]
    return DataError(
        f'{table.path}: no column "{usual}"; the file has {table.listing()}'
        f"{nearest(usual, table.headers)} ({advice})"
    )
