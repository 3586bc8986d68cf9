"""Even clock from the times in a file: order, gaps, evenness, sample time.

- A time may lie 2.5 % of a sample off the even clock: at 50 Hz, 0.5 ms, which moves a 1 Hz signal by 0.3 % of its
  amplitude, below the noise of the sensors that deatwin is made for.
- Times that are stored with few digits may lie half a digit off, between gaps up to a quarter of a sample. Then many
  steps are a digit off; a few odd ones are not from rounding.
- Test machines log an extra sample where a segment ends, which shifts the clock. While such steps are at most 0.5 % of
  all, the record is interpolated between samples no farther apart than one step, and its provenance says so.
- A step longer than 1.6 samples is a gap; with more than three, and more than 1 % of all steps, the record is uneven.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.rounded import Rounded, each_as_often, rounded_clock
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.resampling import resampling_options

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_JITTER = 0.025  # Largest distance of a time from the even clock, in samples
_ROUNDING = 0.25  # Largest distance of a rounded time from the even clock, in samples
_SHORT_STEPS = 0.005  # Largest share of steps that may be too short
_LONG_STEPS = 0.01  # Largest share of steps that may be gaps
_ROUNDED_STEPS = 0.1  # Least share of unusual steps if the times are rounded
_AGREE = 0.0025  # Distance from the even clock, in samples, up to which a start is kept as in the file
_FEW_GAPS = 3  # Number of gaps that a record of any length may have
_GAP = 1.6  # Step above which there is a gap, in samples
_AS_GOOD = 1.25  # Ratio of the largest distances from two even clocks up to which one fits as well as the other
_EXACT = 1e-9  # Distance from the even clock, in samples, that is none
_FULL = 1e-4  # Relative difference from the size of a counter at which times that fall tell its overflow
_SLACK = 1.1  # Factor on the tolerance, because rounded times move the fitted clock a little


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Consecutive samples of a file, without a gap."""

    first: int  # First row of the piece, counted from the first row of samples
    last: int  # Row after the last one of the piece
    timepts: Floats  # Times of these rows as the file has them, s
    clock: Floats  # The even clock, s
    interpolated: bool  # True if the rows are off the even clock and have to be interpolated
    remark: str = ""  # Description of what was done to the times

    @classmethod
    def even(cls, samples: int, sample_time: float, start: float) -> "Piece":
        """Return a complete file with a stated clock as one piece. `sample_time` is the time between two samples, s."""
        clock = start + sample_time * np.arange(samples, dtype=np.float64)
        return cls(first=0, last=samples, timepts=clock, clock=clock, interpolated=False)

    def take(self, values: Floats) -> Floats:
        """Return a channel on the clock of this piece, shape (k,)."""
        rows = values[self.first : self.last]
        return np.interp(self.clock, self.timepts, rows) if self.interpolated else rows


def even_pieces(
    timepts: Floats, where: Callable[[int], str], *, allow_gaps: bool, stated: float | None = None
) -> tuple[float, list[Piece]]:
    """Return the sample time, s, and the even pieces of times, s; `where` returns a sample's place for an error."""
    if len(timepts) == 1 and stated:
        return stated, [Piece.even(1, stated, float(timepts[0]))]
    if len(timepts) < 2:
        raise DataError(f"{where(0)}: there is only one sample; a recording needs at least two")
    steps = np.diff(timepts)
    if rounded := _read_as_even(timepts, stated):
        return rounded.sample_time, [_evenly(rounded, timepts)]
    if (steps <= 0.0).any():
        raise _not_increasing(timepts, where)
    usual = float(np.median(steps))
    meant = stated or usual  # sample time that the advice names
    tolerance = _SLACK * max(_JITTER * usual, min(_rounding(timepts, steps, usual), _ROUNDING * usual))
    long = steps > _GAP * usual
    short = steps < usual - 2.0 * tolerance
    if long.sum() > max(_FEW_GAPS, _LONG_STEPS * len(steps)) or short.sum() > _SHORT_STEPS * len(steps):
        raise _odd_step(timepts, np.abs(steps - usual) > 2.0 * tolerance, usual, tolerance, where, meant)
    if (odd := ~long & (steps > usual + 2.0 * tolerance)).any():
        raise _odd_step(timepts, odd, usual, tolerance, where, meant)
    runs = list(pairwise([0, *(np.flatnonzero(long | short) + 1), len(timepts)]))
    sample_time = _sample_time(timepts, runs, usual, tolerance, where, stated)
    if long.any() and not allow_gaps:
        raise _gap(timepts, long, usual, where)
    edges = [0, *(np.flatnonzero(long) + 1), len(timepts)]
    return sample_time, list(_pieces(timepts, edges, short, sample_time, tolerance))


def _read_as_even(timepts: Floats, stated: float | None) -> Rounded | None:
    """Return the even clock that fits rounded times; None if it cannot be determined."""
    return None if not stated and each_as_often(timepts) else rounded_clock(timepts, stated)


def _evenly(rounded: Rounded, timepts: Floats) -> Piece:
    """Return all rows on the even clock that fits rounded times; report it if the old clock is lost."""
    first, step = float(timepts[0]), rounded.sample_time
    start = first if abs(rounded.start - first) <= _AGREE * step else rounded.start
    said = f"the times are stored only to {rounded.digit:.2g} s, so evenly spaced times were assumed, one every {step:.9g} s"
    piece = Piece.even(len(timepts), step, start)
    return replace(piece, remark=said if rounded.digit > 2.0 * _ROUNDING * step else "")


def _not_increasing(timepts: Floats, where: Callable[[int], str]) -> DataError:
    """Return an error for times that repeat or go back, with a remedy."""
    steps = np.diff(timepts)
    at = np.flatnonzero(steps <= 0.0) + 1
    row = int(at[0])
    more = f" ({len(at)} such rows in all)" if len(at) > 1 else ""
    advice, offers = "remove the repeated rows, or correct their times", NO_OPTIONS
    if (back := steps < 0.0).any():
        row = int(np.argmax(back)) + 1
        usual = float(np.median(np.abs(steps)))
        fallen = usual - float(steps[row - 1])
        advice = "put the rows in order"
        if len(at) == 1 and steps.max() < _GAP * usual:  # nothing is missing that came too early
            advice = f"there the clock was set back: add {fallen:.6g} s from there on, or give each part its own file"
        if timepts[row] <= timepts[0] + usual:
            advice = "there the clock starts again: give each run its own file"
        advice = "the rows run backwards: put them in order" if back.mean() > 0.5 else advice
        advice = _overflow(fallen) or advice
        advice = _changed_clock(steps[row - 1], usual) + advice
    elif rounded := rounded_clock(timepts):
        offers = ReadOptions(dt=float(f"{rounded.sample_time:.9g}"))
        advice = f"the times are printed too coarsely; if the rows are evenly sampled, state the sample time: {offers}"
    elif (steps == 0.0).mean() > 0.5:
        advice = "the times are stored too coarsely to show the sample time; if the rows are evenly sampled, state it: --dt SECONDS"
    return DataError(
        f"{where(row)}: times do not increase: {timepts[row]:.9g} s follows {timepts[row - 1]:.9g} s{more}; {advice}",
        offers,
    )


def _overflow(back: float) -> str:
    """Return the advice if times fall by a minute, a day, or as much as a counter of 16, 24 or 32 bits holds in s, ms or us."""
    if abs(back / 60.0 - 1.0) < _FULL:
        return "there the seconds of a minute begin again: write hours, minutes and seconds in one column, as in 12:00:00.25"
    full = (86400.0, *(2.0**bits / rate for bits in (32, 24, 16) for rate in (1e6, 1e3, 1.0)))
    size = next((size for size in full if abs(back / size - 1.0) < _FULL), None)
    return "" if size is None else f"there the counter of the times began again at 0: add {size:.10g} s from there on"


def _pieces(timepts: Floats, edges: list[int], short: Flags, sample_time: float, tolerance: float) -> Iterator[Piece]:
    """Yield the pieces between gaps; a piece with a short step must be interpolated."""
    origin = None
    for first, last in pairwise(edges):
        rows = timepts[first:last]
        start = _start(rows, sample_time)
        origin = start if origin is None else origin
        common = origin + sample_time * round((start - origin) / sample_time)
        if _AGREE * sample_time < abs(common - start) <= tolerance:
            start = common
        shifted = bool(short[first : last - 1].any())
        samples = int((rows[-1] - rows[0]) / sample_time * (1.0 + 1e-9)) + 1 if shifted else len(rows)
        yield Piece(
            first=int(first),
            last=int(last),
            timepts=rows,
            clock=(rows[0] if shifted else start) + sample_time * np.arange(samples, dtype=np.float64),
            interpolated=shifted,
        )


def _start(rows: Floats, sample_time: float) -> float:
    """Return the first time of an even clock: that of the file, unless a fit to all times differs."""
    late = rows - rows[0] - sample_time * np.arange(len(rows))
    shift = 0.5 * float(late.max() + late.min())
    return float(rows[0]) + (shift if abs(shift) > _AGREE * sample_time else 0.0)


def _rounding(timepts: Floats, steps: Floats, usual: float) -> float:
    """Return the largest rounding error of the times, s: half their last digit; 0 if they are not rounded."""
    if (np.abs(steps - usual) > 1e-6 * usual).mean() < _ROUNDED_STEPS:
        return 0.0
    for decimals in range(7):
        if np.allclose(timepts, np.round(timepts, decimals), rtol=1e-14, atol=1e-12):
            return float(0.5 * 10.0**-decimals)
    return 0.0


def _sample_time(
    timepts: Floats,
    runs: list[tuple[int, int]],
    usual: float,
    tolerance: float,
    where: Callable[[int], str],
    stated: float | None,
) -> float:
    """Return the sample time of all pieces: the stated one, else a fitted one, else the usual step."""
    ranks = np.concatenate([np.arange(last - first) - 0.5 * (last - first - 1) for first, last in runs])
    since = timepts - timepts[0]
    fitted = float(ranks @ since / (ranks @ ranks)) if ranks.any() else usual
    late = np.concatenate([_off_clock(timepts[first:last], stated or fitted) for first, last in runs])
    if late.max() <= tolerance:
        return stated or _with_few_digits(fitted, float(late.max()), timepts, runs)
    if not stated and max(_off_clock(timepts[first:last], usual).max() for first, last in runs) <= tolerance:
        return float(f"{usual:.9g}")
    sample = int(np.argmax(late))
    if stated:
        raise DataError(
            f"{where(sample)}: the stated sample time is {stated:g} s, but the times advance by {fitted:.9g} s per "
            "sample; correct one of the two"
        )
    options = resampling_options(timepts, fitted)
    raise DataError(
        f"{where(sample)}: uneven sampling: the time {timepts[sample]:g} s deviates by {late[sample]:.3g} s "
        f"from even times every {fitted:g} s (tolerance {tolerance:.2g} s); {_advice(options)}",
        options or NO_OPTIONS,
    )


def _with_few_digits(fitted: float, late: float, timepts: Floats, runs: list[tuple[int, int]]) -> float:
    """Return the step of fewest digits whose clock fits as well as the fitted one, from which times are up to `late` off.

    Recordings of one clock then have one sample time, although rounding and jitter differ.
    """
    for step in (float(f"{fitted:.{digits}g}") for digits in range(1, 12)):
        off = max(_off_clock(timepts[first:last], step).max() for first, last in runs)
        if off <= _AS_GOOD * late + _EXACT * fitted:
            return step
    return fitted


def _off_clock(timepts: Floats, step: float) -> Floats:
    """Return the distance of each time from an even clock through their middle, s."""
    late = timepts - timepts[0] - step * np.arange(len(timepts))
    return np.abs(late - 0.5 * (late.max() + late.min()))


def _gap(timepts: Floats, long: Flags, usual: float, where: Callable[[int], str]) -> DataError:
    """Return the error that names the first gap."""
    sample = int(np.argmax(long))
    before, after = timepts[sample], timepts[sample + 1]
    more = f" ({int(long.sum())} gaps in all)" if long.sum() > 1 else ""
    count = round((after - before) / usual) - 1
    advice = _changed_clock(after - before, usual) + "fill the gap, or split the recording there"
    missing = "1 sample is" if count == 1 else f"{count} samples, one every {usual:g} s, are"
    return DataError(
        f"{where(sample + 1)}: a gap from {before:g} s to {after:g} s, in which {missing} missing{more}; "
        f"{advice} (--allow-gaps, in Python allow_gaps=True)",
        ReadOptions(allow_gaps=True),
    )


def _changed_clock(step: float, usual: float) -> str:
    """Return the remark that the clock was changed, if a step, s, is an hour or twelve longer or shorter than usual."""
    causes = {
        "an hour: where summer time began or ended, give the times with their offset from UTC": 3600.0,
        "twelve hours: if the clock shows no am and pm, give times of 24 hours": 43200.0,
    }
    off = (cause for cause, size in causes.items() if abs(abs(step - usual) - size) < min(0.5 * usual, 1.0))
    return "".join(f"exactly {cause}; else " for cause in off)


def _odd_step(
    timepts: Floats, odd: Flags, usual: float, tolerance: float, where: Callable[[int], str], meant: float
) -> DataError:
    """Return an error that names the first row that comes too early or too late."""
    sample = int(np.argmax(odd)) + 1
    step, options = timepts[sample] - timepts[sample - 1], resampling_options(timepts, meant)
    return DataError(
        f"{where(sample)}: uneven sampling: the time {timepts[sample]:g} s is {step:g} s after that of the row "
        f"before, but the usual interval is {usual:g} s (tolerance {2.0 * tolerance:.2g} s); {_advice(options)}",
        options or NO_OPTIONS,
    )


def _advice(options: ReadOptions | None) -> str:
    """Return advice for uneven times."""
    if options is None:
        return "resample the recording to even times"
    gaps = ", allow_gaps=True" if options.allow_gaps else ""
    return f"resample the recording to even times: {options}, in Python resample={options.resample:g}{gaps}"
