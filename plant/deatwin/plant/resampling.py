"""Samples at uneven times, or too many of them, onto an even clock.

Readings are interpolated linearly. A command that changes seldom is a staircase, of which a new row takes the level in
the middle of its hold; any other is averaged over the hold. For a longer sample time, `decimate` filters first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array, real_numbers, seconds
from deatwin.plant.decimation import decimate, low_pass_gain, require_means
from deatwin.plant.errors import DataError
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.recording import Recording, label
from deatwin.plant.rigs.base import ReadingTime, require_reading_time

_GAP = 5.0  # Step above which there is a gap, in usual steps; the module's docstring gives the reason
_FOLDED = 1.1
"""Longest sample time without filtering, in usual steps. It folds only the last tenth of the band, of which linear
interpolation leaves less than half anyway."""
_FINEST = 10.0
"""Largest number of new rows per usual step. With ten, nine of ten rows already lie on a straight line between two
others, and a model would learn the interpolation."""
_STAYS = 0.5  # Share of unchanged rows from which a command is a staircase
_TOLD = 2000  # Number of new rows that determine the gain of the interpolation to 1 %
_ROUNDED = 1e-6  # Jitter, in steps, up to which times are even apart from rounding in print
_TAKEN = {ReadingTime.START_OF_HOLD: 0.0, ReadingTime.MEAN_OVER_HOLD: 0.5, ReadingTime.END_OF_HOLD: 1.0}
"""When a reading is taken after the time of its row, in steps."""
_SAME = 1e-9  # Tolerance, in steps, of times that differ by rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampling:
    """Result of planning how samples are brought onto an even clock."""

    sample_time: float
    factor: int  # Ratio of the new sample time to that of the finer clock from which the samples are decimated
    clocks: tuple[Array, ...]  # Finer clock of each piece between gaps, s
    rows: tuple[tuple[int, int], ...]  # First row of each piece, and the row after its last one
    timepts: Array  # Times of the rows, s
    reading: ReadingTime
    means: Collection[str]  # Names of the readings that are means over a row
    shorter: float  # Length of an old row minus that of a finer row, s

    @property
    def steps(self) -> Array:
        """Times between successive rows of one piece, s."""
        return np.concatenate([np.diff(self.timepts[first:last]) for first, last in self.rows])

    def bandwidth(self) -> float:
        """Frequency at which a reading has lost 3 dB, Hz; at most the new Nyquist frequency."""
        # With new rows finer than the old ones, interpolation leaves nothing at the old sampling rate.
        frequencies = np.linspace(0.0, min(0.5 / self.sample_time, 1.0 / float(np.median(self.steps))), 257)
        gain = np.abs(self._interpolation(frequencies))
        gain *= low_pass_gain(self.factor, frequencies * self.sample_time, self.reading)
        lost = gain < math.sqrt(0.5)
        return float(frequencies[np.argmax(lost)] if lost.any() else frequencies[-1])

    def sentence(self) -> str:
        """Describe the resampling in one line."""
        steps = self.steps
        usual, spread = float(np.median(steps)), float(np.std(steps))
        nyquist = 0.5 / self.sample_time
        told = f"steps of {steps.min():.4g} to {steps.max():.4g} s (usually {usual:.4g} s, jitter {spread:.2g} s rms)"
        told = told if spread > _ROUNDED * usual else f"even steps of {usual:.6g} s"
        how = f"by means of {self.factor}" if self.reading is ReadingTime.MEAN_OVER_HOLD else "after a low-pass filter"
        thinned = f" {how}, from {self.sample_time / self.factor:.4g} s" if self.factor > 1 else ""
        return (
            f"from {told} onto an even clock of {self.sample_time:.6g} s{thinned}: readings are interpolated "
            f"linearly and keep {self.bandwidth():.3g} Hz to 3 dB (Nyquist frequency {nyquist:.4g} Hz); commands are held"
        )

    @property
    def late(self) -> float:
        """How much sooner after its row's time a reading is taken in the finer rows than in the old ones, s."""
        return _TAKEN[self.reading] * self.shorter

    def readings(self, piece: int, values: Array, name: str) -> Array:
        """Return a reading on the finer clock of a piece."""
        first, last = self.rows[piece]
        averaged = name in self.means and self.reading is not ReadingTime.MEAN_OVER_HOLD
        late = self.late - 0.5 * self.shorter if averaged else self.late
        return np.interp(self.clocks[piece] - late, self.timepts[first:last], values[first:last])

    def commands(self, piece: int, values: Array) -> Array:
        """Return a command on the finer clock of a piece: levels of a staircase, means of any other."""
        first, last = self.rows[piece]
        times, levels, clock = self.timepts[first:last], values[first:last], self.clocks[piece]
        hold = self.sample_time / self.factor
        if np.mean(np.diff(values) == 0.0) >= _STAYS:
            return levels[np.maximum(np.searchsorted(times, clock + 0.5 * hold, side="right") - 1, 0)]
        ends = np.append(times, max(times[-1], clock[-1]) + hold)
        area = np.concatenate([[0.0], np.cumsum(levels * np.diff(ends))])
        return np.diff(np.interp([clock, clock + hold], ends, area), axis=0)[0] / hold

    def _interpolation(self, frequencies: Array) -> NDArray[np.complex128]:
        """Return the mean gain of the interpolation over the new rows, given the times of the old ones."""
        before, after = [], []
        for clock, (first, last) in zip(self.clocks, self.rows, strict=True):
            times, clock = self.timepts[first:last], clock - self.late
            row = np.clip(np.searchsorted(times, clock, side="right") - 1, 0, len(times) - 2)
            before.append(clock - times[row])
            after.append(times[row + 1] - clock)
        early, late = np.concatenate(before), np.concatenate(after)
        thin = max(1, early.size // _TOLD)
        early, late = early[::thin, None], late[::thin, None]
        share = early / (early + late)
        turn = 2j * np.pi * frequencies
        return np.asarray(np.mean((1 - share) * np.exp(-turn * early) + share * np.exp(turn * late), axis=0))


def plan_resampling(
    timepts: Array,
    sample_time: float,
    where: Callable[[int], str],
    *,
    allow_gaps: bool = False,
    reading: ReadingTime = ReadingTime.END_OF_HOLD,
    means: Collection[str] = (),
    at_gaps: str = "(--allow-gaps, in Python allow_gaps=True)",
) -> Resampling:
    """Plan how rows at these times are brought onto an even clock."""
    if not (math.isfinite(sample_time) and sample_time > 0.0):
        raise DataError(f"{where(0)}: the new sample time is {sample_time} s; it must be positive")
    if len(timepts) < 2:
        raise DataError(f"{where(0)}: there is only one sample; a recording needs at least two")
    steps = np.diff(timepts)
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0))
        raise DataError(
            f"{where(row + 1)}: times do not increase: {timepts[row + 1]:.9g} s follows {timepts[row]:.9g} s; "
            "remove repeated rows, and put the others in order"
        )
    usual = float(np.median(steps))
    if usual > _FINEST * (1.0 + _SAME) * sample_time:
        options = resampling_options(timepts)
        raise DataError(
            f"{where(0)}: rows every {usual:g} s are too sparse for a sample time of {sample_time:g} s: "
            f"{round(usual / sample_time) - 1} of {round(usual / sample_time)} new rows would be invented; choose a sample time of {usual / _FINEST:.6g} s or more, such as "
            f"{options or ''}",
            options or NO_OPTIONS,
        )
    # A step shorter than the new sample time is no gap, because nothing is missing between two new rows.
    long = steps > max(_GAP * usual, _FOLDED * sample_time)
    if long.any() and not allow_gaps:
        row = int(np.argmax(long))
        raise DataError(
            f"{where(row + 1)}: a gap from {timepts[row]:g} s to {timepts[row + 1]:g} s, while the usual interval is "
            f"{usual:g} s: a gap of more than {_GAP:g} usual intervals is not interpolated; split the recording there "
            + at_gaps,
            ReadOptions(allow_gaps=True),
        )
    factor = 1 if sample_time <= _FOLDED * usual else math.ceil(sample_time / usual * (1.0 - _SAME))
    shorter = usual - sample_time / factor
    if abs(shorter) <= np.median(np.abs(steps - usual)):  # jitter hides it
        shorter = 0.0
    late = _TAKEN[reading] * shorter
    edges = [0, *(np.flatnonzero(long) + 1), len(timepts)]
    found = [
        (clock, (int(first), int(last)))
        for first, last in pairwise(edges)
        if (clock := _clock(timepts[first:last], timepts[0], sample_time, factor, late)).size > factor
    ]
    if not found:
        raise DataError(
            f"{where(0)}: no part of the recording without a gap is long enough for two samples {sample_time:g} s "
            "apart; choose a shorter sample time"
        )
    return Resampling(
        sample_time=sample_time,
        factor=factor,
        clocks=tuple(clock for clock, _ in found),
        rows=tuple(rows for _, rows in found),
        timepts=timepts,
        reading=reading,
        means=means,
        shorter=shorter,
    )


def resampling_options(timepts: Array, usual: float | None = None) -> ReadOptions | None:
    """Return the options that bring rows at uneven times, s, onto an even clock; None where none do."""
    if len(timepts) < 2 or not (np.diff(timepts) > 0.0).all():
        return None
    step = float(f"{np.median(np.diff(timepts)) if usual is None else usual:.2g}")
    for allow_gaps in (False, True):
        try:
            plan_resampling(timepts, step, str, allow_gaps=allow_gaps)
        except DataError:
            continue
        return ReadOptions(resample=step, allow_gaps=allow_gaps)
    return None


def _clock(times: Array, origin: float, sample_time: float, factor: int, late: float) -> Array:
    """Return the times of the finer clock within a piece, aligned with the new clock, that have a command and a reading."""
    start = origin + sample_time * math.ceil((times[0] + max(late, 0.0) - origin) / sample_time - _SAME)
    fine = sample_time / factor
    count = math.floor((times[-1] + min(late, 0.0) - start) / fine + _SAME * len(times)) + 1
    return np.asarray(start + fine * np.arange(max(count, 0), dtype=np.float64))


@taking(recording=instance(Recording, error=DataError))
def resample(
    recording: Recording,
    sample_time: float,
    *,
    timepts: ArrayLike | None = None,
    reading: ReadingTime = ReadingTime.END_OF_HOLD,
    means: Collection[str] = (),
) -> Recording:
    """Convert a recording to a new sample time, or from uneven to even times.

    Outputs and further channels are interpolated linearly, between the times at which they were read. Each command is
    held until the time of the next command. If the commands form a staircase, a new command is the command in the
    middle of the new sample; otherwise it is the mean command over the new sample. If the new sample time is longer
    than the old one, the signals are then low-pass filtered and decimated, as in
    `deatwin.ident.narx.preprocess.decimate`.

    Parameters
    ----------
    recording : Recording
        Recording to resample.
    sample_time : float
        New sample time, s.
    timepts : (n,) array_like, optional
        True times of the samples, s; by default, the times on the recording's clock.
    reading : ReadingTime
        Time within a sample at which the reading is taken, in both recordings. With the default, the reading of a row
        belongs to the end of its sample, which is later in a longer sample.
    means : collection of str
        Names of the outputs and further channels that are means, as in `deatwin.ident.narx.preprocess.decimate`.

    Returns
    -------
    Recording
        Resampled recording; its provenance states how it was resampled.

    Raises
    ------
    DataError
        If there is not one time for each sample; if the times do not increase; if a step between two times exceeds both
        five times the median step and 1.1 new sample times; if the new sample time is shorter than a tenth of the
        median step; if `means` is text or names no output or further channel; or if the recording is too short.

    Examples
    --------
    >>> times = [0.0, 0.015, 0.04, 0.063, 0.08]
    >>> rows = Recording.from_arrays([0.0, 0.0, 1.0, 1.0, 1.0], [0.0, 1.5, 4.0, 6.3, 8.0], 0.02)
    >>> resample(rows, 0.02, timepts=times).outputs.round(6).tolist()
    [[0.0, 2.0, 4.0, 6.0, 8.0]]
    """
    times = recording.timepts if timepts is None else real_numbers(timepts, "timepts")
    sample_time = seconds(sample_time, "sample_time")
    if times.shape != (recording.n_samples,) or not np.isfinite(times).all():
        raise DataError(
            f"timepts have the shape {times.shape}; they must be {recording.n_samples} finite times, one for each row"
        )
    name = label(recording)
    require_reading_time(reading, DataError)
    require_means(means, recording)
    plan = plan_resampling(
        times,
        sample_time,
        lambda row: f"{name}, sample {row}",
        reading=reading,
        means=means,
        at_gaps="and resample each part; read_recordings splits a file with allow_gaps=True",
    )
    fine = replace(
        recording,
        inputs=np.array([plan.commands(0, row) for row in recording.inputs]).reshape(len(recording.inputs), -1),
        outputs=np.array(
            [plan.readings(0, *row) for row in zip(recording.outputs, recording.output_names, strict=True)]
        ).reshape(len(recording.outputs), -1)
        if len(recording.outputs)
        else np.empty((0, plan.clocks[0].size)),
        extras={extra: plan.readings(0, row, extra) for extra, row in recording.extras.items()},
        sample_time=sample_time / plan.factor,
        start=float(plan.clocks[0][0]),
        provenance={**recording.provenance, "resampled": plan.sentence()},
    )
    return decimate(fine, plan.factor, reading=reading, means=means)
