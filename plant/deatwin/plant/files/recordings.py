"""Read and write recordings: one file or several, in any format."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TypedDict, TypeVar, Unpack

from numpy.typing import ArrayLike

from deatwin.plant.arguments import file_name, instance, taking
from deatwin.plant.arrays import real_numbers
from deatwin.plant.errors import DataError
from deatwin.plant.files.assemble import on_one_clock, recordings_of
from deatwin.plant.files.columns import chosen_columns
from deatwin.plant.files.csvtable import TEXTS, read_table
from deatwin.plant.files.csvwrite import csv_text
from deatwin.plant.files.formats.lvm import read_lvm
from deatwin.plant.files.formats.mat import read_mat, write_mat
from deatwin.plant.files.formats.netcdf import read_netcdf, write_netcdf
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.formats.tdms import read_tdms, write_tdms
from deatwin.plant.files.formats.xlsx import read_xlsx, split_sheet
from deatwin.plant.files.replacing import replacing
from deatwin.plant.files.wanted import in_units, require_known_units, require_stated_unit, with_stated_units
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import ReadingTime, require_reading_time
from deatwin.plant.rigs.rigfile import RigFile

Way = TypeVar("Way")

_COLUMN = instance(str, error=DataError)

# A new format needs a line in each table: a reader that returns a Table, and a writer of a Recording.
_READERS: dict[str, Callable[[str | Path], Table]] = {
    **dict.fromkeys(TEXTS, read_table),
    ".lvm": read_lvm,
    ".xlsx": read_xlsx,
    ".xlsm": read_xlsx,
    ".mat": read_mat,
    ".h5": read_mat,
    ".hdf5": read_mat,
    ".tdms": read_tdms,
    ".nc": read_netcdf,
}
ENDINGS = tuple(_READERS)  # Endings of the names of files that can be read
_FRAMES = {
    ".json": "pandas.read_json",
    ".parquet": "pandas.read_parquet",
    ".feather": "pandas.read_feather",
    **dict.fromkeys((".pkl", ".pickle"), "pandas.read_pickle"),
}
_ADVICE = {
    **{ending: f'in Python, write it as CSV: {read}("{{0}}").to_csv("{{1}}")' for ending, read in _FRAMES.items()},
    ".npy": 'in Python, write it as CSV: numpy.savetxt("{1}", numpy.load("{0}"), delimiter=",")',
    ".npz": 'in Python, write it as CSV: pandas.DataFrame(dict(numpy.load("{0}"))).to_csv("{1}")',
    **dict.fromkeys((".mf4", ".mdf"), 'in Python, write it as CSV: asammdf.MDF("{0}").to_dataframe().to_csv("{1}")'),
    **dict.fromkeys((".xls", ".xlsb", ".ods"), "save the sheet as .xlsx or .csv"),
    **dict.fromkeys((".wfm", ".isf", ".trc", ".bin"), "save the waveforms as CSV on the oscilloscope"),
}
"""How to convert other formats, by the ending of a file's name; the file is ``{0}``, the table ``{1}``."""
_PACKED = (".gz", ".7z", ".bz2", ".xz", ".zst", ".rar", ".tar", ".tgz")
_WRITERS: dict[str, Callable[[Path, Recording], None]] = {
    ".csv": lambda path, recording: _write_text(path, csv_text(recording)),
    ".mat": write_mat,
    ".tdms": write_tdms,
    ".nc": write_netcdf,
}


class _Options(TypedDict, total=False):
    """Options of `read_recordings` that also apply to a recording without gaps."""

    input_column: str | None
    output_column: str | None
    time_column: str | None
    dt: float | None
    resample: float | None
    reading: ReadingTime
    input_unit: str | None
    output_unit: str | None
    rig: RigFile | None
    readings: Sequence[Reading]


@taking(path=file_name, input_column=_COLUMN, time_column=_COLUMN, output_column=_COLUMN)
def read_recordings(
    path: str | Path,
    *,
    input_column: str | None = None,
    output_column: str | None = None,
    time_column: str | None = None,
    allow_gaps: bool = False,
    dt: float | None = None,
    resample: float | None = None,
    reading: ReadingTime = ReadingTime.END_OF_HOLD,
    input_unit: str | None = None,
    output_unit: str | None = None,
    rig: RigFile | None = None,
    readings: Sequence[Reading] = (),
) -> tuple[Recording, ...]:
    """Read the recordings in a file; the file name extension determines the format.

    Parameters
    ----------
    path : str or Path
        File to read. For one sheet of a workbook, append its name: ``lab.xlsx#Sheet2``.
    input_column, output_column : str, optional
        Column of the input and column of the output: the header, or the position, ``"#2"`` for the second column. By
        default, the columns that the file declares as input and output, else the columns ``command`` and
        ``displacement``. The unit is read from the header, from a line of units or from an attribute of the column. It
        can also be given here after an equals sign: ``"#2=mm"``.
    time_column : str, optional
        Column of the times: the header, or the position. By default, the column called ``time`` or similar, else the
        column with a unit of time. The unit is read from the header, or given here after an equals sign:
        ``"Timestamp=ms"``. Without a unit, the times are in s. For dates, give the order of day, month and year:
        ``"Date=dmy"``, ``"Date=mdy"`` or ``"Date=ymd"``. ``"UTC=hhmmss"`` reads 143005.25 as 14:30:05.25. Time 0 of
        dates and of Unix times is the first sample; the provenance states its date as ``clock_began``.
    allow_gaps : bool, default False
        If True, the data are split at gaps into several recordings on one clock; otherwise a gap is an error.
    dt : float, optional
        Sample time, s, for a file without times. If the file has times, they must agree with `dt`.
    resample : float, optional
        New sample time, s; see `deatwin.plant.resample`. Use it for unevenly spaced times, and for files that were
        sampled faster than needed.
    reading : ReadingTime
        Time within a sample at which the reading is taken, also after resampling.
    input_unit, output_unit : str, optional
        Unit of the input and of the output in the returned recording; SI by default. A column in another unit of the
        same kind is converted; ``"1"`` is the unit of plain numbers. An output column without a unit is an error if
        `output_unit` is given and is not ``"1"``. All other columns without a unit are used unchanged.
    rig : RigFile, optional
        Rig file. Commands far outside the rig's range, or displacements larger than the rig, raise an error. The
        further readings that the rig file lists are read as `readings`, unless `readings` are given.
    readings : sequence of Reading, optional
        Further readings besides the output. Each becomes an extra channel with the name of the reading, in which NaN
        marks a missing value.

    Returns
    -------
    tuple of Recording
        One recording; with `allow_gaps`, one recording for each part between gaps.

    Raises
    ------
    DataError
        If the file cannot be read, or a package for its format is not installed; if a column or its unit cannot be
        determined; if a value is not a number; or if the times do not increase, are unevenly spaced
        (without `resample`) or have gaps (without `allow_gaps`).
    """
    asked = {"input": input_column, "output": output_column, "time": time_column}
    units = {"input": input_unit, "output": output_unit}
    return recordings_of_table(
        table_of_file(path),
        asked,
        units,
        allow_gaps=allow_gaps,
        dt=dt,
        resample=resample,
        reading=reading,
        rig=rig,
        readings=readings or _readings(rig),
    )


@taking(path=file_name, input_column=_COLUMN, time_column=_COLUMN)
def read_commands(
    path: str | Path,
    *,
    input_column: str | None = None,
    time_column: str | None = None,
    dt: float | None = None,
    resample: float | None = None,
    reading: ReadingTime = ReadingTime.END_OF_HOLD,
    input_unit: str | None = None,
    rig: RigFile | None = None,
) -> Recording:
    """Read only the commands of a file; the file needs no output column.

    Parameters
    ----------
    path, input_column, time_column, dt, resample, reading, input_unit, rig
        Same as in `read_recordings`.

    Returns
    -------
    Recording
        Recording without outputs.

    Raises
    ------
    DataError
        Same as for `read_recordings`.
    """
    asked, units = {"input": input_column, "time": time_column}, {"input": input_unit}
    return recordings_of_table(
        table_of_file(path), asked, units, allow_gaps=False, dt=dt, resample=resample, reading=reading, rig=rig
    )[0]


def read_recording(path: str | Path, **options: Unpack[_Options]) -> Recording:
    """Read a file that contains one recording without gaps.

    Parameters
    ----------
    path : str or Path
        File to read.
    **options
        Options of `read_recordings` except `allow_gaps`.

    Returns
    -------
    Recording
        The recording.

    Raises
    ------
    DataError
        Same as for `read_recordings`; also for `allow_gaps`.
    """
    if "allow_gaps" in options:
        raise DataError(
            "read_recording returns one recording, but allow_gaps divides a file at its gaps: use read_experiment or "
            "read_recordings, which return all parts"
        )
    return read_recordings(path, allow_gaps=False, **options)[0]


@taking(paths=instance(Iterable, PathLike, error=DataError))
def read_experiment(
    paths: Iterable[str | Path] | str | Path, *, allow_gaps: bool = False, **options: Unpack[_Options]
) -> Experiment:
    """Read the recordings of one experiment, from one file or several.

    Parameters
    ----------
    paths : iterable of (str or Path), str or Path
        Files, in any order, or one file. Dated files have dates as times, or are TDMS files with a ``wf_start_time``;
        their times are converted to the clock of the earliest file. The times of other files must be on one clock.
    allow_gaps : bool, default False
        If True, the data are split at gaps into several recordings on one clock; otherwise a gap is an error.
    **options
        Other options of `read_recordings`, the same for all files.

    Returns
    -------
    Experiment
        The recordings, sorted by start time.

    Raises
    ------
    DataError
        Same as for `read_recordings` and `Experiment`.
    """
    listed = (paths,) if isinstance(paths, str | PathLike) else paths
    files = (read_recordings(path, allow_gaps=allow_gaps, **options) for path in listed)
    return Experiment(recordings=on_one_clock([recording for file in files for recording in file]))


@taking(path=file_name, recording=instance(Recording, error=DataError))
def write_recording(path: str | Path, recording: Recording) -> None:
    """Write a recording to a file, from which `read_recording` reads exactly the same values.

    A CSV file has one column for each signal, with the name and the unit of the signal as its header. Where the columns
    cannot hold the whole recording, such as its provenance, a first line that begins with ``# deatwin/recording/1``
    holds the rest. The other formats hold the values in SI units.

    Parameters
    ----------
    path : str or Path
        File to write, ``.csv``, ``.mat``, ``.tdms`` or ``.nc``; it is written completely or not at all.
    recording : Recording
        Recording to write.

    Raises
    ------
    DataError
        If the format is unknown, a package for it is not installed, or the file cannot be written.
    """
    write = _by_ending(path, _WRITERS, "written")
    with replacing(path) as temporary:
        write(temporary, recording)


@taking(path=file_name, columns=instance(Mapping, error=DataError))
def write_csv(path: str | Path, columns: Mapping[str, ArrayLike]) -> None:
    """Write columns of numbers to a CSV file, with as many digits as an exact copy needs.

    Parameters
    ----------
    path : str or Path
        File to write; it is written completely or not at all.
    columns : mapping of str to (n,) array_like
        Values of each column, by header. A header that ends with an underscore and a unit, such as ``displacement_m``,
        tells `read_recordings` the unit. A header must not contain a comma, a double quote or a line break.

    Raises
    ------
    DataError
        If the columns differ in length or are not one-dimensional, if a header contains a forbidden character, or if
        the file cannot be written.
    """
    values = {name: real_numbers(column, f"{path}: the column {name}") for name, column in columns.items()}
    shapes = {column.shape for column in values.values()}
    if len(shapes) != 1 or len(shapes.pop()) != 1:
        raise DataError(f"{path}: columns must be one-dimensional and of one length: {', '.join(values)}")
    if unfit := [name for name in values if any(mark in name for mark in ',"\r\n')]:
        raise DataError(f'{path}: the header "{unfit[0]}" holds a comma, a quote or a line break')
    rows = zip(*(column.tolist() for column in values.values()), strict=True)
    write_text_atomic(path, "\n".join([",".join(values), *(",".join(map(repr, row)) for row in rows)]) + "\n")


@taking(path=file_name, text=instance(str, error=DataError))
def write_text_atomic(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file atomically, so that no other program can read a half-written file.

    Parameters
    ----------
    path : str or Path
        File to write.
    text : str
        Content of the file.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    with replacing(path) as temporary:
        _write_text(temporary, text)


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="")


def _by_ending(path: str | Path, ways: Mapping[str, Way], verb: str) -> Way:
    """Return the reader or writer of a file's format."""
    name = Path(split_sheet(path)[0] if verb == "read" else path)
    ending = name.suffix.lower()
    if verb == "read" and (ending == ".zip" or (ending == ".gz" and name.with_suffix("").suffix.lower() in TEXTS)):
        return ways[".csv"]
    if ending in _PACKED and verb == "read":
        raise DataError(f"{path}: it is packed; unpack it, and give the file inside it")
    if ending not in ways and verb == "read" and Path(path).is_dir():
        raise DataError(f"{path}: this is a folder; give the files in it")
    if ending not in ways:
        kind = f"files {f'with the extension {ending}' if ending else 'without an extension'}"
        hint = f"known are {', '.join(ways)}"
        if verb == "read":
            hint += "; rename a text file to .txt, and write any other table as CSV, in Python with DataFrame.to_csv of pandas"
            hint = _ADVICE.get(ending, hint).format(name.name, name.with_suffix(".csv").name)
        raise DataError(f"{path}: {kind} cannot be {verb}; {hint}")
    return ways[ending]


def _readings(rig: RigFile | None) -> tuple[Reading, ...]:
    return () if rig is None else rig.readings


def table_of_file(path: str | Path) -> Table:
    """Read the table of a file in the format of its name; under any other name, it may be a table of text."""
    try:
        read = _by_ending(path, _READERS, "read")
    except DataError as unknown:
        if Path(path).suffix.lower() in _PACKED:
            raise
        try:
            return read_table(path)
        except DataError:
            raise unknown from None
    return read(path)


def recordings_of_table(
    table: Table,
    asked: Mapping[str, str | None],
    units: Mapping[str, str | None],
    *,
    allow_gaps: bool,
    dt: float | None,
    resample: float | None,
    reading: ReadingTime,
    rig: RigFile | None,
    readings: Sequence[Reading] = (),
) -> tuple[Recording, ...]:
    """Make recordings from a table, whose columns the user may have named."""
    require_reading_time(reading, DataError)
    table, asked = with_stated_units(table, asked)
    chosen = chosen_columns(table, asked, units)
    wanted = {column: unit for role, unit in units.items() if unit is not None for column in chosen[role]}
    table = in_units(table, wanted)
    for column in chosen["output"]:
        require_stated_unit(table, column, units["output"] or "")
    require_known_units(table, [column for role in chosen if asked.get(role) is not None for column in chosen[role]])
    return recordings_of(
        table,
        chosen,
        allow_gaps=allow_gaps,
        dt=dt,
        resample=resample,
        reading=reading,
        rig=rig,
        named_times=asked["time"],
        readings=readings,
    )
