"""Make recordings from the table of a file: clock, pieces, signals."""

import logging
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.checks import check_command_range, check_motion
from deatwin.plant.decimation import decimate
from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import Piece, even_pieces
from deatwin.plant.files.columns import extra_columns, require_wide, with_readings
from deatwin.plant.files.dates import ORDERS, moment
from deatwin.plant.files.formats.description import all_provenance
from deatwin.plant.files.formats.table import Signal, Table, Timing
from deatwin.plant.files.formats.tdms import STARTED
from deatwin.plant.files.timecolumns import (
    counts_by_one,
    is_count,
    is_nameless,
    likely_times,
    no_times,
    require_unit,
    time_column,
    times_options,
    unit_of_steps,
    unpadded,
    with_times,
)
from deatwin.plant.files.times import BEGAN, DATES, TIMES_OF_DAY
from deatwin.plant.files.units import UNITS
from deatwin.plant.files.usual import LIKE_TIMES, USUAL_TIMES
from deatwin.plant.readings import ELECTRICAL_UNITS, MEANS, Reading
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.recording import Recording, label, stated_seconds
from deatwin.plant.resampling import Resampling, plan_resampling
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.safe_read import clipped

logger = logging.getLogger(__name__)

_FEW_RUNS = 10  # Least number of rows per run
_RUN = re.compile(
    r"(?i)(?<![^\W_])(trial|run|segment|sweep|shot|repeat|repetition|experiment|versuch|messung|lauf)s?(?![^\W\d_])"
)
"""Names of a column with the number of the run to which a row belongs."""
_COUNTED = 0.9  # Share of steps by 1 from which a column counts the rows
_FAR = 10.0  # Distance of an equal value from all others, in their range, from which it may mark a missing value
_MARK = re.compile(r"[-+]?(9{3,}(\.(9+|25|0+))?|99\.9{2,})")
"""Number that loggers write for a missing value: -9999, -999.25, 99.9999."""
_LIMITS = {sign * (2**bits - 1) - (sign < 0) for bits in (15, 23, 31) for sign in (1, -1)} | {2**16 - 1, 2**32 - 1}
"""Least and greatest integer of a converter with 16, 24 or 32 bits."""
_SLOW = 0.5  # Step, s, above which times without a unit may be in another one


Floats = NDArray[np.float64]


def recordings_of(
    table: Table,
    chosen: Mapping[str, tuple[int, ...]],
    *,
    allow_gaps: bool,
    dt: float | None,
    resample: float | None,
    reading: ReadingTime,
    rig: RigFile | None,
    named_times: str | None = None,
    readings: Sequence[Reading] = (),
) -> tuple[Recording, ...]:
    """Return the recordings of a table."""
    taken = [column for columns in chosen.values() for column in columns]
    declared = [column for role in ("input", "output", "extra") for column in table.columns_of(role)]
    needed = dt is None and table.timing(taken or declared) is None
    times, unit = time_column(table, {*taken, *declared}, named_times, needed=needed)
    if dt is not None and named_times is None and times is not None and not _is_filled(table, times):
        times = None  # the column holds only a sample time in one cell, as benchmark files do
    bare = table
    if times is not None:
        table = with_times(table, times, unit)
        _tell_times(table, times, unit, named_times)
    others = {*taken, *([] if times is None else [times])}
    further: Mapping[int, Reading] = {}
    if readings:
        table, further = with_readings(table, readings, others)
    roles = {**chosen, "extra": (*further, *extra_columns(table, others | further.keys()))}
    used = [column for columns in roles.values() for column in columns]
    stated = _stated(table, used, dt)
    wanted = list(dict.fromkeys([*used, *([] if times is None else [times])]))  # one column may have two roles
    table = table.without_cut_number(wanted)
    spotty = {
        *further,
        *(k for k, name in enumerate(table.names) if table.declared.signals or name in ELECTRICAL_UNITS),
    }
    needed_columns = [*roles["input"], *roles["output"]]
    missing = [*needed_columns, *(column for column in roles["extra"] if column in spotty)]
    numbers = dict(zip(wanted, table.si(wanted, missing=missing), strict=True))
    for column in missing:
        for mark in table.marks:
            marked = np.isclose(numbers[column], table.unit(column).to_si(np.array(mark)), rtol=1e-12, atol=0.0)
            numbers[column] = np.where(marked, np.nan, numbers[column])
    whole = numbers
    kept = _rows_with_values(
        table, {k: numbers[k] for k in needed_columns}, timed=times is not None, allow_gaps=allow_gaps
    )
    numbers, kept, held = _on_rows_read(table, numbers, kept, roles, times, reading)
    if times is None and stated is None:
        raise no_times(table, set(used))
    told = None if times is None else numbers[times]
    # If a sample time is stated, a column without a unit that counts the rows adds no information.
    counted = (
        told is not None and dt is not None and not unit and named_times is None and bool((np.diff(told) == 1).all())
    )
    told = None if counted else told
    if told is not None and times is not None and not unit and times not in table.scales:
        require_unit(bare, times, told)
    unsaid = times is not None and not unit and not table.scales and table.headers[times] != USUAL_TIMES
    steps = np.diff(told) if told is not None and unsaid else np.empty(0)
    ticks = bool(steps.size and (steps > _SLOW).all() and np.allclose(steps, np.round(steps), rtol=0.0, atol=1e-6))
    remark = ""
    if times is not None and told is not None:
        slow = stated is None and steps.size and np.median(steps) > _SLOW
        remark = _seconds_or_other(table, times, told) if slow else ""
    elif counted and times is not None and dt != 1.0:
        remark = f'the stated sample time was used, because the column "{table.shown(times)}" only counts the rows'
    elif stated:
        remark = _passed_over(table, used, stated.sample_time) or _against_even_rows(table, used)
    remark = "; ".join(text for text in (held, remark) if text)
    source = _Source(table=table, roles=roles, numbers=numbers, kept=kept, remark=remark)
    try:
        recordings = _recordings(
            source,
            told,
            stated,
            allow_gaps=allow_gaps,
            resample=resample,
            reading=reading,
            means=() if rig is None else MEANS,
        )
    except DataError as error:
        if times is not None and (fault := unpadded(table, times)):
            raise DataError(fault) from None
        if told is not None and times is not None and (np.diff(told) <= 0.0).any():
            require_wide(table)
            _require_no_finer_times(bare, others, times)
            _require_no_copies(source, told)
        if times is None or not ticks:
            raise
        offers = ReadOptions(time_column=f"{table.unmistakable(times)}=ms")
        raise DataError(
            f'{error}; if the column "{table.shown(times)}" is not in seconds, state its unit: {offers}',
            offers | error.offers,
        ) from None
    if table.left_out:
        logger.warning("%s: the last row was left out, because %s", table.path, table.left_out)
    if table.scale and not table.declared.signals:
        logger.warning(
            '%s: a remark in the file says "%s", which is not applied; if the numbers lack this scale, state the unit for which '
            "they stand, or apply the scale to them",
            table.path,
            clipped(table.scale),
        )
    for column in needed_columns:
        _tell_marks(table, column, whole[column], is_input=column in roles["input"])
    if rig is not None:
        for recording in recordings:
            check_command_range(recording, rig.drive)
            check_motion(recording, rig.widest)
    return recordings


def _rows_with_values(table: Table, needed: Mapping[int, Floats], *, timed: bool, allow_gaps: bool) -> NDArray[np.intp]:
    """Return the rows in which command and reading have values; other rows become gaps, if allowed."""
    gone = np.isnan(list(needed.values()))
    lost = gone.any(axis=0)
    if not lost.any() or (timed and allow_gaps and not lost.all()):
        return np.flatnonzero(~lost)
    sample, count, offers = int(np.argmax(lost)), int(lost.sum()), NO_OPTIONS
    column = list(needed)[int(np.argmax(gone[:, sample]))]
    if gone.all(axis=1).any():
        advice = "give a column that has values"
    elif lost.all():
        advice = (
            "no row has command and reading: fill the empty cells of the command with the command that was held then"
        )
    elif not timed:
        advice = "fill it, or give a column of times"
    else:
        advice = "fill it, or leave such rows out: --allow-gaps, in Python allow_gaps=True"
        offers = ReadOptions(allow_gaps=True)
    more = f" ({count} such rows in all)" if count > 1 else ""
    written = next(islice(table.texts(column), sample, None)).strip()
    why = f", because the file says that {clipped(written)} marks a missing one" if table.marks and written else ""
    raise DataError(
        f'{table.where(sample)}, column "{table.shown(column)}": there is no value{why}{more}; {advice}', offers
    )


def _on_rows_read(
    table: Table,
    numbers: Mapping[int, Floats],
    kept: NDArray[np.intp],
    roles: Mapping[str, tuple[int, ...]],
    times: int | None,
    reading: ReadingTime,
) -> tuple[dict[int, Floats], NDArray[np.intp], str]:
    """Return the numbers in rows with values, these rows, and a remark: if usually every m-th row has a reading, m rows
    make a new one, whose command is their mean.
    """
    needed = [numbers[column] for role in ("input", "output") for column in roles[role]]
    filled = np.flatnonzero(~np.isnan(needed).all(axis=0))  # rows without command and reading do not count
    place = np.searchsorted(filled, kept)
    every = int(np.median(np.diff(place))) if len(place) > 1 else 1
    if every == 1:
        return {column: values[kept] for column, values in numbers.items()}, kept, ""
    first = place if reading is ReadingTime.START_OF_HOLD else place - every + 1
    whole = (first >= 0) & (first + every <= len(filled))
    held, kept = filled[first[whole, np.newaxis] + np.arange(every)], kept[whole]
    if times is not None:  # rows on both sides of a gap are not one hold
        spans = np.ptp(numbers[times][held], axis=1)
        together = spans < 1.5 * np.median(spans)
        held, kept = held[together], kept[together]
    found = {column: values[kept] for column, values in numbers.items()}
    changed = 0
    for column in roles["input"]:
        levels = numbers[column][held]
        if np.isnan(levels).any():
            row = int(held.flat[np.argmax(np.isnan(levels))])
            raise DataError(
                f'{table.where(row)}, column "{table.shown(column)}": there is no value; fill it with the command that was held then'
            )
        moves = np.ptp(levels, axis=1) > 0.0
        changed = max(changed, int(moves.sum()))
        found[column] = np.where(moves, levels.mean(axis=1), levels[:, 0])
    if times is not None:
        found[times] = numbers[times][held[:, 0]]
    within = f" (it changed within {changed} of the {len(kept)})" if changed else ""
    said = f"one row in {every} has a reading: {every} rows became one, with their mean command{within}"
    return found, kept, said


def _require_no_copies(source: "_Source", times: Floats) -> None:
    """Refuse rows of equal times (n,) that are copies of the rows before: no finer clock lies behind them."""
    again = np.flatnonzero(np.diff(times) == 0.0) + 1
    pairs = [(values[again - 1], values[again]) for values in source.numbers.values()]
    if again.size and all(np.array_equal(*pair, equal_nan=True) for pair in pairs):
        more = f" ({again.size} such rows in all)" if again.size > 1 else ""
        raise DataError(
            f"{source.where(int(again[0]))}: the row repeats the one before{more}; remove the repeated rows"
        )


def _require_no_finer_times(table: Table, others: set[int], times: int) -> None:
    """Refuse times that repeat or go back where another column of times increases."""
    for column in likely_times(table, others):
        if UNITS[table.units[column]].si == "s" or LIKE_TIMES.search(table.names[column]):
            offers = times_options(table, column)
            raise DataError(
                f'{table.path}: the times in the column "{table.shown(times)}" repeat or go back, but those in the column '
                f'"{table.shown(column)}" increase; name it: {offers}',
                offers,
            )


def _is_filled(table: Table, column: int) -> bool:
    """Return whether a column has a value in more than one row."""
    return sum(bool(text.strip()) for text in table.texts(column)) > 1


def _tell_times(table: Table, times: int, unit: str, named: str | None) -> None:
    """Warn how the times were interpreted, unless the file states it."""
    if times == 0 and is_nameless(table) and named is None:
        logger.warning(
            '%s: without a header %s first column, which rises evenly, is taken as the times%s; --time-column "#1=ms" '
            "states another unit, --dt another sample time",
            table.path,
            "its" if table.nameless else "the",
            "" if table.scales.get(times) else " in s",
        )
    if not unit and (scale := table.scales.get(times)) and scale.unit and scale.began:
        logger.warning(
            '%s: the column "%s" holds %s, as their size says; its clock starts at %s',
            table.path,
            table.shown(times),
            scale.said,
            scale.began.isoformat(),
        )


def _tell_marks(table: Table, column: int, values: Floats, *, is_input: bool) -> None:
    """Warn of an outermost value of a column (n,) that may mark missing values; commands may also have far levels."""
    known = values[~np.isnan(values)]
    found, counts = np.unique(known, return_counts=True)
    for k in {0, found.size - 1} if found.size > 3 and not table.declared.signals else ():
        sample = int(np.argmax(values == found[k]))
        written = next(islice(table.texts(column), sample, None)).strip()
        usual = _MARK.fullmatch(written) is not None
        at_limit = written.lstrip("+-").isdecimal() and int(written) in _LIMITS
        apart = (np.abs(rest - found[k]).min() > _FAR * np.ptp(rest) for rest in (np.delete(found, k), found[1:-1]))
        far = (usual or at_limit or (counts[k] > 1 and not is_input)) and any(apart)
        if far or (at_limit and counts[k] > 1 and not is_input):
            logger.warning(
                '%s, column "%s": %s stands in %d row%s, %s; if it marks missing values, leave these cells empty',
                table.where(sample),
                table.shown(column),
                clipped(written),
                counts[k],
                "s" if counts[k] > 1 else "",
                "far outside all other values" if far else "the limit of an integer",
            )


def on_one_clock(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings on the clock of the earliest one, if all state the date of their time zero."""
    dates = [recording.provenance.get(STARTED, recording.provenance.get(BEGAN)) for recording in recordings]
    files = " and ".join(label(recording) for recording in recordings)
    undated = [one for one, date in zip(recordings, dates, strict=True) if date is None]
    if len(dates) > 1 and any(one.provenance.get("times") == DATES for one in undated):
        raise DataError(
            f"{files}: some of their dates may have the day, the month or the year first, and none shows which; state the order "
            f"for all: --time-column NAME={ORDERS[0]}, NAME={ORDERS[1]} or NAME={ORDERS[2]}"
        )
    of_day = any(one.provenance.get("times") == TIMES_OF_DAY for one in undated)
    if (
        undated
        and len({one.provenance.get("file") for one in recordings}) > 1
        and (of_day or len(undated) < len(dates))
    ):
        raise DataError(
            f"{files}: the times of {label(undated[0])} tell no date, so the time between the files is unknown; write date and "
            "time in one column of each file, or put --experiment before each file that began from rest"
        )
    if undated or len(set(dates)) < 2:
        return tuple(recordings)
    try:
        began = [moment(str(date)) for date in dates]
    except ValueError:
        raise DataError(
            f"{files}: the values of {STARTED} are not dates; give the times of all recordings on one clock"
        ) from None
    if len({date.tzinfo for date in began}) > 1:
        raise DataError(
            f"{files}: some of their dates have an offset from UTC and others have none; give all of them an offset, or none"
        )
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
    """Return the clock stated in the file, else that stated by the user."""
    dt = None if dt is None else stated_seconds(dt, f"{table.path}: dt")
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise DataError(f"{table.path}: dt is {dt} s; the sample time must be positive")
    stated = table.timing(used)
    if stated and dt is not None and not stated.agrees(dt):
        raise DataError(f"{table.path}: its sample time is {stated.sample_time:g} s, but dt is {dt:g} s; leave dt out")
    return stated or (Timing(sample_time=dt) if dt is not None else None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Source:
    """Columns of a table that become signals, by role, with their numbers."""

    table: Table
    roles: Mapping[str, tuple[int, ...]]
    numbers: Mapping[int, Floats]
    kept: NDArray[np.intp]  # Rows of the table that `numbers` contains
    remark: str

    def where(self, sample: int) -> str:
        """Return file and row of a sample."""
        return self.table.where(int(self.kept[sample]))

    def recording(
        self,
        clock: Floats,
        sample_time: float,
        take: Mapping[str, Callable[[Floats, str], Floats]],
        about: Mapping[str, str],
    ) -> Recording:
        """Make a recording from selected rows of each column, by role."""
        signals, rows = self._signals(), {}
        for role, columns in self.roles.items():
            taken = [
                take[role](self.numbers[column], signal.name)
                for column, signal in zip(columns, signals[role], strict=True)
            ]
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
            provenance=all_provenance(about, self.table.declared.provenance),
        )

    def _signals(self) -> dict[str, list[Signal]]:
        """Return the signals for each role."""
        table = self.table
        signals = {role: [table.signal(role, column) for column in columns] for role, columns in self.roles.items()}
        shared = {signal.name for signal in signals["input"]} & {signal.name for signal in signals["output"]}
        if shared and not table.declared.signals:  # both measure one quantity; their headers differ by the units
            for role in ("input", "output"):
                signals[role] = [replace(signal, name=signal.header) for signal in signals[role]]
        return signals

    def origin(self, first: int, last: int, remark: str = "") -> dict[str, str]:
        """Return the origin of rows `first` to `last` - 1, with a `remark` on their clock."""
        table = self.table
        rows = f"{table.row(int(self.kept[first]))}-{table.row(int(self.kept[last - 1]))}"
        remarks = [text for text in (self.remark, remark) if text]
        clock = {"clock": "; ".join(remarks)} if remarks else {}
        for scale in table.scales.values():
            clock |= scale.provenance
        return {"file": table.path, "sha256": table.sha256, "rows": rows, **clock}


def _recordings(
    source: _Source,
    told: Floats | None,
    stated: Timing | None,
    *,
    allow_gaps: bool,
    resample: float | None,
    reading: ReadingTime,
    means: Collection[str],
) -> tuple[Recording, ...]:
    """Return the recordings of the rows, at the times in the file or on the stated clock."""
    samples = source.kept.size
    step, start = (stated.sample_time, stated.start) if stated else (0.0, 0.0)
    if resample is not None and not (stated.agrees(resample) if told is None and stated else _is_even(told, resample)):
        timepts = start + step * np.arange(samples, dtype=np.float64) if told is None else told
        plan = plan_resampling(timepts, resample, source.where, allow_gaps=allow_gaps, reading=reading, means=means)
        return _resampled(source, plan)
    if told is None:
        pieces = [Piece.even(samples, step, start)]
    else:
        step, pieces = even_pieces(
            told, source.where, allow_gaps=allow_gaps, stated=stated.sample_time if stated else None
        )
    return tuple(
        source.recording(
            piece.clock,
            step,
            dict.fromkeys(source.roles, _nameless(piece.take)),
            source.origin(piece.first, piece.last, piece.remark)
            | ({"resampled": "linear, from times off the even clock"} if piece.interpolated else {}),
        )
        for piece in pieces
    )


def _nameless(take: Callable[[Floats], Floats]) -> Callable[[Floats, str], Floats]:
    """Return a function that also takes the name of the signal, which does not matter to `take`."""
    return lambda values, _: take(values)


def _resampled(source: _Source, plan: Resampling) -> tuple[Recording, ...]:
    """Resample rows to an even clock, and return the recordings."""
    made = []
    for piece, (clock, rows) in enumerate(zip(plan.clocks, plan.rows, strict=True)):
        readings, commands = partial(plan.readings, piece), _nameless(partial(plan.commands, piece))
        take: dict[str, Callable[[Floats, str], Floats]] = {"input": commands, "output": readings, "extra": readings}
        about = source.origin(*rows) | {"resampled": plan.sentence()}
        fine = source.recording(clock, plan.sample_time / plan.factor, take, about)
        try:
            means = {*plan.means} & {*fine.output_names, *fine.extras}
            made.append(decimate(fine, plan.factor, reading=plan.reading, means=means))
        except DataError as error:  # too short for the filter
            raise DataError(
                f"{source.where(rows[0])}, with a sample every {plan.sample_time:g} s: {error}", error.offers
            ) from None
    return tuple(made)


def _passed_over(table: Table, used: Sequence[int], dt: float) -> str:
    """Describe uneven times in a column without a unit of time; empty if there are none."""
    named = [
        k
        for k, name in enumerate(table.names)
        if k not in used and LIKE_TIMES.search(name) and UNITS[table.units[k]].si in ("", "s")
    ]
    for column in named:
        try:
            found = table.si([column])[0]
        except DataError:
            continue
        steps = np.diff(found)
        if not (steps.size and (steps > 0.0).all()):
            continue
        try:
            even_pieces(found, str, allow_gaps=True)
        except DataError:
            unit = "" if table.units[column] else unit_of_steps(float(np.median(steps)), dt)
            return (
                f'the stated sample time was taken; the column "{table.shown(column)}" was ignored, although it '
                f"looks like uneven times, in steps of {steps.min():g} to {steps.max():g}; if it holds the times, name it: "
                f"{times_options(table, column, unit, dt)}"
            )
    return ""


def _against_even_rows(table: Table, used: Sequence[int]) -> str:
    """Describe a column by which the rows do not follow each other evenly: a broken count of them, or several runs."""
    for column in sorted(set(range(len(table.names))).difference(used)):
        first = list(islice(table.texts(column), 2))
        if not (_RUN.search(table.names[column]) or counts_by_one(first)):
            continue  # it need not be read to its end
        cells = list(table.texts(column))
        changes = [k for k, (before, after) in enumerate(pairwise(cells), 1) if after != before]
        blocks = 0 < len(changes) < len(cells) / _FEW_RUNS and len(set(cells)) == len(changes) + 1
        if blocks and _RUN.search(table.names[column]):
            k, said = changes[0], "if another run begins there, give each run a file of its own"
        elif all(map(is_count, cells)) and (k := _break_of(list(map(int, cells)))):
            again = int(cells[k]) <= int(cells[0])
            said = "if another run begins there, give each run a file of its own"
            said = said if again else "if samples are missing or repeated there, write the time of each row in a column"
        else:
            continue
        return (
            f'the stated sample time was taken from row to row, but the column "{table.shown(column)}" goes from '
            f"{clipped(cells[k - 1])} to {clipped(cells[k])} in row {table.row(k)}; {said}"
        )
    return ""


def _break_of(counts: Sequence[int]) -> int:
    """Return the first place at which a count of the rows does not go on by 1; 0 if there is none, or no such count.

    A counter that is full, at a power of two or ten, goes on at its lowest number.
    """
    steps = [after - before for before, after in pairwise(counts)]
    if steps.count(1) < _COUNTED * len(steps):
        return 0
    full = {2**bits for bits in range(8, 65, 8)} | {10**digits for digits in range(2, 10)}
    odd = (k for k, step in enumerate(steps, 1) if step != 1)
    return next((k for k in odd if not (counts[k] == min(counts) < 2 and counts[k - 1] + 1 - counts[k] in full)), 0)


def _seconds_or_other(table: Table, times: int, told: Floats) -> str:
    """Ask for the unit of times without one that would be slow as seconds."""
    named, step = f'--time-column "{table.unmistakable(times)}', float(np.median(np.diff(told)))
    counted = "do they count the samples? Then state the sample time, --dt SECONDS; " if step == 1.0 else ""
    return (
        f'the column "{table.shown(times)}" gives no unit, and its steps were taken as seconds, '
        f'{step:g} s a sample; {counted}are they milliseconds? Then state {named}=ms", else {named}=s"'
    )


def _is_even(told: Floats | None, sample_time: float) -> bool:
    """Return whether times already follow an even clock."""
    try:
        kept, _ = even_pieces(np.empty(0) if told is None else told, str, allow_gaps=True)
    except DataError:
        return False
    return Timing(sample_time=kept).agrees(sample_time)
