"""From the table of a file to recordings: which clock, which pieces, which signals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.checks import check_command_range, check_motion
from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import Piece, even_pieces
from deatwin.plant.files.columns import extra_columns, no_times, time_column
from deatwin.plant.files.formats.description import all_provenance
from deatwin.plant.files.formats.table import Table, Timing
from deatwin.plant.files.formats.tdms import STARTED
from deatwin.plant.recording import Recording, label
from deatwin.plant.rigs.rigfile import RigFile

__all__ = ["on_one_clock", "recordings_of"]


def recordings_of(
    table: Table,
    chosen: Mapping[str, tuple[int, ...]],
    *,
    allow_gaps: bool,
    dt: float | None,
    rig: RigFile | None,
) -> tuple[Recording, ...]:
    """Return the recordings of a table.

    Parameters
    ----------
    table : Table
        What a file holds.
    chosen : mapping of str to tuple of int
        The columns of the ``input`` and of the ``output``.
    allow_gaps : bool
        Split the record at its gaps. Else a gap is an error.
    dt : float or None
        Sample time, s, that the user states.
    rig : RigFile or None
        Refuse commands far outside of this rig's range.

    Returns
    -------
    tuple of Recording

    Raises
    ------
    DataError
        If nothing says the times, two statements of them contradict each other, or the values are at fault.
    """
    taken = [column for columns in chosen.values() for column in columns]
    declared = [column for role in ("input", "output", "extra") for column in table.columns_of(role)]
    times = time_column(table, {*taken, *declared})
    roles = {**chosen, "extra": tuple(extra_columns(table, {*taken, *([] if times is None else [times])}))}
    used = [column for columns in roles.values() for column in columns]
    stated = _stated(table, used, dt)
    wanted = list(dict.fromkeys([*used, *([] if times is None else [times])]))  # one column may have two roles
    numbers = dict(zip(wanted, table.si(wanted), strict=True))
    if times is not None:
        sample_time, pieces = even_pieces(
            numbers[times], table.where, allow_gaps=allow_gaps, stated=stated.sample_time if stated else None
        )
    elif stated:
        sample_time = stated.sample_time
        pieces = [Piece.even(len(numbers[used[0]]), sample_time, stated.start)]
    else:
        raise no_times(table)
    recordings = tuple(_recording(table, roles, numbers, piece, sample_time) for piece in pieces)
    if rig is not None:
        for recording in recordings:
            check_command_range(recording, rig.drive)
            check_motion(recording, rig.film)
    return recordings


def on_one_clock(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings on the clock of the earliest, if all of them say at which date their own clock began.

    Parameters
    ----------
    recordings : sequence of Recording
        From several files.

    Returns
    -------
    tuple of Recording
        The same ones where not all have a date or the date is one; else shifted, the earliest date in their
        provenance as ``clock_began``.
    """
    dates = [recording.provenance.get(STARTED) for recording in recordings]
    if None in dates or len(set(dates)) < 2:
        return tuple(recordings)
    try:
        began = np.array(dates, dtype="datetime64[us]")
        if np.isnat(began).any():
            raise ValueError("no date")
    except ValueError:
        files = " and ".join(label(recording) for recording in recordings)
        raise DataError(f"{files}: their {STARTED} are no dates; give the recordings one running clock") from None
    shifts = (began - began.min()) / np.timedelta64(1, "s")
    return tuple(
        replace(
            recording,
            start=recording.start + float(shift),
            provenance={key: value for key, value in recording.provenance.items() if key != STARTED}
            | {"clock_began": str(began.min())},
        )
        for recording, shift in zip(recordings, shifts, strict=True)
    )


def _stated(table: Table, used: list[int], dt: float | None) -> Timing | None:
    """Return the clock that the file states, else the one that the user does."""
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise DataError(f"{table.path}: dt is {dt} s; the sample time must be positive")
    stated = table.timing(used)
    if stated and dt is not None and not stated.agrees(dt):
        raise DataError(
            f"{table.path}: its sample time is {stated.sample_time:g} s, but dt is {dt:g} s; leave dt out"
        )
    return stated or (Timing(sample_time=dt) if dt is not None else None)


def _recording(
    table: Table,
    roles: Mapping[str, tuple[int, ...]],
    numbers: Mapping[int, NDArray[np.float64]],
    piece: Piece,
    sample_time: float,
) -> Recording:
    """Return the recording of one piece of a table, whose columns `numbers` holds in SI units."""

    def rows(role: str) -> NDArray[np.float64]:
        channels = [piece.take(numbers[column]) for column in roles[role]]
        return np.reshape(channels, (len(channels), len(piece.clock)))

    signals = {role: [table.signal(role, column) for column in columns] for role, columns in roles.items()}
    return Recording(
        inputs=rows("input"),
        outputs=rows("output"),
        sample_time=sample_time,
        start=float(piece.clock[0]),
        input_names=tuple(signal.name for signal in signals["input"]),
        input_units=tuple(signal.unit for signal in signals["input"]),
        output_names=tuple(signal.name for signal in signals["output"]),
        output_units=tuple(signal.unit for signal in signals["output"]),
        extras={signal.name: row for signal, row in zip(signals["extra"], rows("extra"), strict=True)},
        extra_units={signal.name: signal.unit for signal in signals["extra"]},
        provenance=_provenance(table, piece),
    )


def _provenance(table: Table, piece: Piece) -> dict[str, str]:
    """Return where the samples of a piece come from."""
    own = {
        "file": table.path,
        "sha256": table.sha256,
        "rows": f"{table.row(piece.first)}-{table.row(piece.last - 1)}",
    }
    resampled = {"resampled": "linear, from times off the even clock"} if piece.interpolated else {}
    return all_provenance(own | resampled, table.declared.provenance)
