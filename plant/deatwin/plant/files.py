"""Recordings from files and into files.

A CSV recording has the columns ``time_s,command_V,displacement_mm``; further channels may be
``film_voltage_V``, ``current_uA``, ``temperature_C`` and ``force_N``; other columns are passed over. The last
part of a name is its unit and may be another one of the same kind. Inside, everything is in SI units.
"""

import secrets
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.checks import check_command_range
from deatwin.plant.clock import Piece, even_pieces
from deatwin.plant.columns import COLUMNS, data_column, extra_columns, time_column
from deatwin.plant.csvtable import CsvTable, read_table
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.units import UNITS, split_unit


def read_csv(
    path: str | Path,
    *,
    input_column: str | None = None,
    output_column: str | None = None,
    allow_gaps: bool = False,
    rig: RigFile | None = None,
) -> tuple[Recording, ...]:
    """Read a CSV recording.

    Parameters
    ----------
    path : str or Path
        The file.
    input_column, output_column : str, optional
        Header of the input and the output, or the place, ``"#2"`` for the second column; by default the
        columns ``command`` and ``displacement``. A unit may stand in the header or in a line below it; values
        without a known unit are taken as they are.
    allow_gaps : bool, default False
        Split the record at its gaps and keep the clock. Else a gap is an error.
    rig : RigFile, optional
        Refuse commands far outside of this rig's range.

    Returns
    -------
    tuple of Recording
        One, or with `allow_gaps` one between every two gaps.

    Raises
    ------
    DataError
        If the file is missing or empty, has no header, lacks a column, holds a cell that is not a number,
        times that do not increase, a gap or uneven sampling, or commands far outside of the rig's range.
    """
    table = read_table(path)
    chosen = {
        "input": data_column(table, "command", input_column),
        "output": data_column(table, "displacement", output_column),
    }
    return _recordings(table, chosen, allow_gaps=allow_gaps, rig=rig)


def read_commands(
    path: str | Path, *, input_column: str | None = None, rig: RigFile | None = None
) -> Recording:
    """Read the commands of a CSV file; an output is neither needed nor looked at.

    Parameters
    ----------
    path : str or Path
        The file.
    input_column : str, optional
        Header or place of the command.
    rig : RigFile, optional
        Refuse commands far outside of this rig's range.

    Returns
    -------
    Recording
        With no rows of outputs.

    Raises
    ------
    DataError
        As `read_csv`.
    """
    table = read_table(path)
    chosen = {"input": data_column(table, "command", input_column)}
    return _recordings(table, chosen, allow_gaps=False, rig=rig)[0]


# MAT, TDMS and NetCDF readers take their place here, each with the signature of `read_csv`.
_READERS: dict[str, Callable[..., tuple[Recording, ...]]] = {
    ".csv": read_csv,
    ".txt": read_csv,
    ".tsv": read_csv,
}


def read_recording(
    path: str | Path,
    *,
    input_column: str | None = None,
    output_column: str | None = None,
    rig: RigFile | None = None,
) -> Recording:
    """Read one recording without gaps, in the format that the end of the file's name says.

    Parameters
    ----------
    path : str or Path
        The file.
    input_column, output_column : str, optional
        Header or place of the input and the output.
    rig : RigFile, optional
        Refuse commands far outside of this rig's range.

    Returns
    -------
    Recording

    Raises
    ------
    DataError
        As `read_csv`, and for a format that is not known.
    """
    return _reader(path)(path, input_column=input_column, output_column=output_column, rig=rig)[0]


def read_experiment(
    paths: Iterable[str | Path],
    *,
    input_column: str | None = None,
    output_column: str | None = None,
    allow_gaps: bool = False,
    rig: RigFile | None = None,
) -> Experiment:
    """Read the recordings of one experiment, which share one running clock.

    Parameters
    ----------
    paths : iterable of (str or Path)
        The files, in any order.
    input_column, output_column : str, optional
        Header or place of the input and the output, the same in all files.
    allow_gaps : bool, default False
        Split records at their gaps. Else a gap is an error.
    rig : RigFile, optional
        Refuse commands far outside of this rig's range.

    Returns
    -------
    Experiment

    Raises
    ------
    DataError
        As `read_csv` and `Experiment`.
    """
    options = {
        "input_column": input_column,
        "output_column": output_column,
        "allow_gaps": allow_gaps,
        "rig": rig,
    }
    recordings = [recording for path in paths for recording in _reader(path)(path, **options)]
    return Experiment(recordings=tuple(recordings))


def write_csv(path: str | Path, columns: Mapping[str, ArrayLike]) -> None:
    """Write columns into a CSV file; what is written reads back as the same numbers.

    Parameters
    ----------
    path : str or Path
        The file; it appears whole or not at all.
    columns : mapping of str to (n,) array_like
        Headers, with the unit as their last part, and values in these units.

    Raises
    ------
    DataError
        If the columns differ in length, or a header is not fit for a CSV file.
    """
    values = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    shapes = {column.shape for column in values.values()}
    if len(shapes) != 1 or len(shapes.pop()) != 1:
        raise DataError(f"{path}: columns must be one-dimensional and of one length: {', '.join(values)}")
    if unfit := [name for name in values if any(mark in name for mark in ',"\r\n')]:
        raise DataError(f'{path}: the header "{unfit[0]}" holds a comma, a quote or a line break')
    rows = zip(*(column.tolist() for column in values.values()), strict=True)
    write_text_atomic(path, "\n".join([",".join(values), *(",".join(map(repr, row)) for row in rows)]) + "\n")


def write_recording(path: str | Path, recording: Recording) -> None:
    """Write a recording as a CSV file that `read_csv` reads; times are rounded to 1 ns.

    Parameters
    ----------
    path : str or Path
        The file.
    recording : Recording
        The usual signals get their usual columns, others their name and SI unit.
    """
    columns = {COLUMNS["time"]: np.round(recording.timepts, 9)}
    names = (*recording.input_names, *recording.output_names, *recording.extras)
    units = (*recording.input_units, *recording.output_units, *[""] * len(recording.extras))
    rows = (*recording.inputs, *recording.outputs, *recording.extras.values())
    for name, unit, values in zip(names, units, rows, strict=True):
        if name in COLUMNS:
            columns[COLUMNS[name]] = UNITS[split_unit(COLUMNS[name])[1]].from_si(values)
        else:
            columns[f"{name}_{unit}" if unit else name] = values
    write_csv(path, columns)


def write_text_atomic(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file through a temporary file beside it, so that no reader sees half of it.

    Parameters
    ----------
    path : str or Path
        The file.
    text : str
        What it shall hold.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        temporary.write_text(text, encoding="utf-8", newline="")
        temporary.replace(target)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _reader(path: str | Path) -> Callable[..., tuple[Recording, ...]]:
    """Return the reader of a file's format."""
    ending = Path(path).suffix.lower()
    if ending not in _READERS:
        raise DataError(f'{path}: files "{ending}" cannot be read; known are {", ".join(_READERS)}')
    return _READERS[ending]


def _recordings(
    table: CsvTable, chosen: dict[str, int], *, allow_gaps: bool, rig: RigFile | None
) -> tuple[Recording, ...]:
    """Return the recordings of a table, given its input column and, if any, its output column."""
    time = time_column(table, set(chosen.values()))
    extras = extra_columns(table, {time, *chosen.values()})
    used = [time, *chosen.values(), *extras.values()]
    numbers = {
        column: UNITS[table.units[column]].to_si(values)
        for column, values in zip(used, table.numbers(used), strict=True)
    }
    sample_time, pieces = even_pieces(numbers[time], table.where, allow_gaps=allow_gaps)
    recordings = tuple(_recording(table, chosen, extras, numbers, piece, sample_time) for piece in pieces)
    if rig is not None:
        for recording in recordings:
            check_command_range(recording, rig.drive)
    return recordings


def _recording(
    table: CsvTable,
    chosen: dict[str, int],
    extras: dict[str, int],
    numbers: dict[int, NDArray[np.float64]],
    piece: Piece,
    sample_time: float,
) -> Recording:
    """Return the recording of one piece of a table, whose columns `numbers` holds in SI units."""

    def rows(role: str) -> NDArray[np.float64]:
        channels = [piece.take(numbers[chosen[role]])] if role in chosen else []
        return np.reshape(channels, (len(channels), len(piece.clock)))

    return Recording(
        inputs=rows("input"),
        outputs=rows("output"),
        sample_time=sample_time,
        start=float(piece.clock[0]),
        input_names=(table.names[chosen["input"]],),
        input_units=(UNITS[table.units[chosen["input"]]].si,),
        output_names=(table.names[chosen["output"]],) if "output" in chosen else (),
        output_units=(UNITS[table.units[chosen["output"]]].si,) if "output" in chosen else (),
        extras={name: piece.take(numbers[column]) for name, column in extras.items()},
        provenance=_provenance(table, piece),
    )


def _provenance(table: CsvTable, piece: Piece) -> dict[str, str]:
    """Return where the samples of a piece come from."""
    found = {
        "file": table.path,
        "sha256": table.sha256,
        "rows": f"{table.rows[piece.first]}-{table.rows[piece.last - 1]}",
    }
    return found | ({"resampled": "linear, from times off the even clock"} if piece.interpolated else {})
