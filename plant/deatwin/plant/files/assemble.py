"""From the table of a file to recordings: which clock, which pieces, which signals."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.checks import check_command_range, check_motion
from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import Piece, even_pieces
from deatwin.plant.files.columns import extra_columns
from deatwin.plant.files.formats.description import all_provenance
from deatwin.plant.files.formats.table import Table, Timing
from deatwin.plant.files.formats.tdms import STARTED
from deatwin.plant.files.timecolumns import no_times, time_column, with_times
from deatwin.plant.files.times import BEGAN, moment
from deatwin.plant.recording import Recording, label
from deatwin.plant.rigs.rigfile import RigFile

logger = logging.getLogger(__name__)

__all__ = ["on_one_clock", "recordings_of"]


def recordings_of(
    table: Table,
    chosen: Mapping[str, tuple[int, ...]],
    *,
    allow_gaps: bool,
    dt: float | None,
    rig: RigFile | None,
    named_times: str | None = None,
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
    named_times : str, optional
        The column of the times that the user asks for.

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
    needed = dt is None and table.timing(taken or declared) is None
    times, unit = time_column(table, {*taken, *declared}, named_times, needed=needed)
    if times is not None:
        table = with_times(table, times, unit)
        _tell_size(table, times, unit)
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
        raise no_times(table, set(used))
    recordings = tuple(_recording(table, roles, numbers, piece, sample_time) for piece in pieces)
    if rig is not None:
        for recording in recordings:
            check_command_range(recording, rig.drive)
            check_motion(recording, rig.film)
    return recordings


def _tell_size(table: Table, times: int, unit: str) -> None:
    """Say which unit the size of Unix times told, where nothing else does."""
    if not unit and (scale := table.scales.get(times)) and not scale.dates:
        logger.warning(
            '%s: the column "%s" holds %s, as their size says; its clock starts at %s',
            table.path, table.shown(times), scale.said, scale.began.isoformat(),
        )  # fmt: skip


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
    dates = [recording.provenance.get(STARTED, recording.provenance.get(BEGAN)) for recording in recordings]
    if None in dates or len(set(dates)) < 2:
        return tuple(recordings)
    files = " and ".join(label(recording) for recording in recordings)
    try:
        began = [moment(str(date)) for date in dates]
    except ValueError:
        raise DataError(f"{files}: their {STARTED} are no dates; give the recordings one running clock") from None
    if len({date.tzinfo for date in began}) > 1:
        raise DataError(f"{files}: some of their dates have an offset from UTC and others have none; give all the same")
    first = min(began)
    return tuple(
        replace(
            recording,
            start=recording.start + (date - first).total_seconds(),
            provenance={key: value for key, value in recording.provenance.items() if key != STARTED}
            | {BEGAN: first.isoformat()},
        )
        for recording, date in zip(recordings, began, strict=True)
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
    shared = {signal.name for signal in signals["input"]} & {signal.name for signal in signals["output"]}
    if shared and not table.declared.signals:  # two columns of one quantity: their units tell them apart
        for role in ("input", "output"):
            signals[role] = [replace(signal, name=signal.header) for signal in signals[role]]
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
    for scale in table.scales.values():
        own |= {"times": scale.said, BEGAN: scale.began.isoformat()}
    resampled = {"resampled": "linear, from times off the even clock"} if piece.interpolated else {}
    return all_provenance(own | resampled, table.declared.provenance)
