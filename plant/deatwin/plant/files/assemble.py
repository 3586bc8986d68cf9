"""From the table of a file to recordings: which clock, which pieces, which signals."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.checks import check_command_range, check_motion
from deatwin.plant.decimation import decimate
from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import Piece, even_pieces
from deatwin.plant.files.columns import extra_columns, no_times, time_column
from deatwin.plant.files.formats.description import all_provenance
from deatwin.plant.files.formats.table import Table, Timing
from deatwin.plant.files.formats.tdms import STARTED
from deatwin.plant.recording import Recording, label
from deatwin.plant.resampling import Resampling, plan_resampling
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.rigfile import RigFile

__all__ = ["on_one_clock", "recordings_of"]

Floats = NDArray[np.float64]
_LIKE_TIMES = re.compile("(?i)time|stamp|clock|millis|zeit|temps|^t$|^ts$")


def recordings_of(
    table: Table,
    chosen: Mapping[str, tuple[int, ...]],
    *,
    allow_gaps: bool,
    dt: float | None,
    resample: float | None,
    reading: ReadingTime,
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
    resample : float or None
        Sample time, s, of the even clock onto which the samples are to be brought.
    reading : ReadingTime
        When, within its row, a reading is taken.
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
    if times is None and stated is None:
        raise no_times(table)
    told = None if times is None else numbers[times]
    source = _Source(table=table, roles=roles, numbers=numbers, passed_over=_passed_over(table, used, times))
    recordings = _recordings(source, told, stated, allow_gaps=allow_gaps, resample=resample, reading=reading)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Source:
    """The columns of a table that become signals, by role, and their numbers."""

    table: Table
    roles: Mapping[str, tuple[int, ...]]
    numbers: Mapping[int, Floats]
    passed_over: str

    def recording(
        self,
        clock: Floats,
        sample_time: float,
        take: Mapping[str, Callable[[Floats], Floats]],
        about: Mapping[str, str],
    ) -> Recording:
        """Return a recording of what is taken of each column by its role."""
        table, signals, rows = self.table, {}, {}
        for role, columns in self.roles.items():
            signals[role] = [table.signal(role, column) for column in columns]
            taken = [take[role](self.numbers[column]) for column in columns]
            rows[role] = np.reshape(taken, (len(columns), clock.size))
        return Recording(
            inputs=rows["input"],
            outputs=rows["output"],
            sample_time=sample_time,
            start=float(clock[0]),
            input_names=tuple(signal.name for signal in signals["input"]),
            input_units=tuple(signal.unit for signal in signals["input"]),
            output_names=tuple(signal.name for signal in signals["output"]),
            output_units=tuple(signal.unit for signal in signals["output"]),
            extras={signal.name: row for signal, row in zip(signals["extra"], rows["extra"], strict=True)},
            extra_units={signal.name: signal.unit for signal in signals["extra"]},
            provenance=all_provenance(about, table.declared.provenance),
        )

    def origin(self, first: int, last: int) -> dict[str, str]:
        """Return where the rows from one up to another come from."""
        table = self.table
        rows = f"{table.row(first)}-{table.row(last - 1)}"
        clock = {"clock": self.passed_over} if self.passed_over else {}
        return {"file": table.path, "sha256": table.sha256, "rows": rows, **clock}


def _recordings(
    source: _Source, told: Floats | None, stated: Timing | None, *, allow_gaps: bool, resample: float | None,
    reading: ReadingTime,
) -> tuple[Recording, ...]:  # fmt: skip
    """Return the recordings of the rows at the times that a file tells, or on the clock that is stated."""
    table, samples = source.table, len(next(iter(source.numbers.values())))
    step, start = (stated.sample_time, stated.start) if stated else (0.0, 0.0)
    if resample is not None and not (stated.agrees(resample) if told is None and stated else _is_even(told, resample)):
        timepts = start + step * np.arange(samples, dtype=np.float64) if told is None else told
        return _resampled(source, plan_resampling(timepts, resample, table.where, allow_gaps=allow_gaps), reading)
    if told is None:
        pieces = [Piece.even(samples, step, start)]
    else:
        step, pieces = even_pieces(
            told, table.where, allow_gaps=allow_gaps, stated=stated.sample_time if stated else None
        )
    return tuple(
        source.recording(
            piece.clock, step, dict.fromkeys(source.roles, piece.take),
            source.origin(piece.first, piece.last)
            | ({"resampled": "linear, from times off the even clock"} if piece.interpolated else {}),
        )
        for piece in pieces
    )  # fmt: skip


def _resampled(source: _Source, plan: Resampling, reading: ReadingTime) -> tuple[Recording, ...]:
    """Return the recordings of rows that are brought onto an even clock."""
    made = []
    for piece, (clock, rows) in enumerate(zip(plan.clocks, plan.rows, strict=True)):
        readings, commands = partial(plan.readings, piece), partial(plan.commands, piece)
        take = {"input": commands, "output": readings, "extra": readings}
        about = source.origin(*rows) | {"resampled": plan.sentence}
        fine = source.recording(clock, plan.sample_time / plan.factor, take, about)
        made.append(decimate(fine, plan.factor, reading=reading))
    return tuple(made)


def _passed_over(table: Table, used: Sequence[int], times: int | None) -> str:
    """Return what is to be said of uneven times in a column that no unit tells to be times; else an empty text."""
    named = [k for k, name in enumerate(table.names) if k not in used and _LIKE_TIMES.search(name)]
    for column in named if times is None else []:
        try:
            found = table.si([column])[0]
        except DataError:
            continue
        steps = np.diff(found)
        if not (steps > 0.0).all():
            continue
        try:
            even_pieces(found, str, allow_gaps=True)
        except DataError:
            return (
                f'the stated sample time was taken; the column "{table.shown(column)}" was passed over, though '
                f"it looks like times that are uneven, in steps of {steps.min():g} to {steps.max():g}: where it holds "
                "them, write their unit behind its name"
            )
    return ""


def _is_even(told: Floats | None, sample_time: float) -> bool:
    """Return whether times keep an even clock already."""
    try:
        kept, _ = even_pieces(np.empty(0) if told is None else told, str, allow_gaps=True)
    except DataError:
        return False
    return Timing(sample_time=kept).agrees(sample_time)
