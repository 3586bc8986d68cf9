"""From the times that a file holds to an even clock: order, gaps, evenness, sample time.

What counts as even, and why:

- A time may lie 2.5 % of a sample off the even clock. At 50 Hz that is 0.5 ms, which moves a 1 Hz signal by
  0.3 % of its amplitude: below the noise of the sensors that deatwin is made for.
- Times that are printed with few digits may lie half a digit off, up to a quarter of a sample: the sampling
  was even, only its print is rounded.
- Test machines log an extra sample where a segment of the test ends, so that a step is short and the clock
  after it shifted. While such steps are at most 0.5 % of all, the record is interpolated on the even clock:
  the steps in between are no longer than a sample, so nothing is invented. Its provenance says so.

A step longer than 1.6 samples is a gap. More than 1 % of such steps is no record with gaps but an uneven one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError

Floats = NDArray[np.float64]

_JITTER = 0.025  # of a sample
_ROUNDING = 0.25  # of a sample, at most
_SHORT_STEPS = 0.005  # of all steps
_LONG_STEPS = 0.01  # of all steps
_GAP = 1.6  # samples
_SLACK = 1.01  # for the last bit of a float


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Samples of a file without a gap between them.

    Parameters
    ----------
    first, last : int
        The rows are ``first`` to ``last - 1``, counted from the first row of samples.
    timepts : (m,) array
        Times of these rows as the file has them, s.
    clock : (k,) array
        The even clock, s.
    interpolated : bool
        Whether the rows are off the even clock and have to be interpolated on it.
    """

    first: int
    last: int
    timepts: Floats
    clock: Floats
    interpolated: bool

    def take(self, values: Floats) -> Floats:
        """Return a channel of the whole file, (n,), on the clock of this piece, (k,), in the same unit."""
        rows = values[self.first : self.last]
        return np.interp(self.clock, self.timepts, rows) if self.interpolated else rows


def even_pieces(
    timepts: Floats, where: Callable[[int], str], *, allow_gaps: bool
) -> tuple[float, list[Piece]]:
    """Return the sample time of a record and its pieces between gaps.

    Parameters
    ----------
    timepts : (n,) array
        Times of the samples, s.
    where : callable
        Takes a sample number and returns how an error text names its place.
    allow_gaps : bool
        Split the record at gaps. Else a gap is an error.

    Returns
    -------
    sample_time : float
        Time between two samples, s; the same for all pieces.
    pieces : list of Piece
        One where there is no gap.

    Raises
    ------
    DataError
        If there are fewer than two samples, times do not increase, there is a gap, or the sampling is uneven.
    """
    if len(timepts) < 2:
        raise DataError(f"{where(0)}: one sample only; a recording needs at least two")
    steps = np.diff(timepts)
    if (steps <= 0.0).any():
        sample = int(np.argmax(steps <= 0.0))
        raise DataError(
            f"{where(sample + 1)}: times do not increase: "
            f"{timepts[sample + 1]:g} s follows {timepts[sample]:g} s"
        )
    usual = float(np.median(steps))
    tolerance = _SLACK * max(_JITTER * usual, min(0.5 * _printed_digit(timepts), _ROUNDING * usual))
    long = steps > _GAP * usual
    short = steps < usual - 2.0 * tolerance
    rare = long.sum() <= 1 + _LONG_STEPS * len(steps) and short.sum() <= _SHORT_STEPS * len(steps)
    if rare and long.any() and not allow_gaps:
        raise _gap(timepts, steps, long, usual, where)

    if not rare:
        raise _uneven(timepts, steps, usual, tolerance, where)
    cuts = [0, *(np.flatnonzero(long | short) + 1), len(timepts)]
    sample_time = _sample_time(timepts, cuts, usual, float(steps[~(long | short)].mean()), tolerance)
    if sample_time is None:
        raise _uneven(timepts, steps, usual, tolerance, where)
    edges = [0, *(np.flatnonzero(long) + 1), len(timepts)]
    return sample_time, list(_pieces(timepts, edges, short, sample_time))


def _pieces(
    timepts: Floats, edges: list[int], short: NDArray[np.bool_], sample_time: float
) -> Iterator[Piece]:
    """Yield the pieces between edges; one that holds a short step is to be interpolated."""
    for first, last in pairwise(edges):
        rows = timepts[first:last]
        shifted = bool(short[first : last - 1].any())
        samples = int((rows[-1] - rows[0]) / sample_time * (1.0 + 1e-9)) + 1 if shifted else len(rows)
        yield Piece(
            first=int(first),
            last=int(last),
            timepts=rows,
            clock=rows[0] + sample_time * np.arange(samples),
            interpolated=shifted,
        )


def _printed_digit(timepts: Floats) -> float:
    """Return the last printed digit of the times, s: 0.001 for three decimals; 0 if it is finer."""
    for decimals in range(7):
        if np.allclose(timepts, np.round(timepts, decimals), rtol=1e-14, atol=1e-12):
            return float(10.0**-decimals)
    return 0.0


def _sample_time(
    timepts: Floats, cuts: list[int], usual: float, mean: float, tolerance: float
) -> float | None:
    """Return the even sample time that all runs between cuts keep: the usual step, else the mean one."""
    for step in (float(f"{usual:.9g}"), mean):
        if all(_off_clock(timepts[first:last], step).max() <= tolerance for first, last in pairwise(cuts)):
            return step
    return None


def _off_clock(timepts: Floats, step: float) -> Floats:
    """Return how far each time lies off an even clock laid through the middle of them, s."""
    late = timepts - timepts[0] - step * np.arange(len(timepts))
    return np.abs(late - 0.5 * (late.max() + late.min()))


def _gap(
    timepts: Floats, steps: Floats, long: NDArray[np.bool_], usual: float, where: Callable[[int], str]
) -> DataError:
    """Return the error that names the first gap."""
    sample = int(np.argmax(long))
    more = f" ({int(long.sum())} gaps in all)" if long.sum() > 1 else ""
    return DataError(
        f"{where(sample + 1)}: a gap from {timepts[sample]:g} s to {timepts[sample + 1]:g} s, "
        f"about {round(steps[sample] / usual) - 1} samples of {usual:g} s{more}; "
        "fill it, or split the record there (--allow-gaps, in Python allow_gaps=True)"
    )


def _uneven(
    timepts: Floats, steps: Floats, usual: float, tolerance: float, where: Callable[[int], str]
) -> DataError:
    """Return the error that names the first row where the sampling is uneven."""
    odd = np.abs(steps - usual) > 2.0 * tolerance
    late = _off_clock(timepts, usual)
    sample = int(np.argmax(odd)) + 1 if odd.any() else int(np.argmax(late > tolerance))
    found = (
        f"{steps[sample - 1]:g} s after the row before, where {usual:g} s is usual"
        if odd.any()
        else f"{late[sample]:g} s off the even clock of {usual:g} s"
    )
    return DataError(
        f"{where(sample)}: uneven sampling: time {timepts[sample]:g} s is {found} "
        f"(tolerance {tolerance:.2g} s); resample the record evenly"
    )
