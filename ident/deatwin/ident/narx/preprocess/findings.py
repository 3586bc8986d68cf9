"""Inspect recordings before a model is fitted: faults are reported, nothing is changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from math import log

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import real_number, whole_number
from deatwin.ident.narx.levels import input_levels, said_of_levels
from deatwin.ident.narx.preprocess.sections import ENOUGH_CORRELATION_TIMES, chance_of_mean, correlation_samples, cut
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.repeats import whole_period_of
from deatwin.ident.soundness import at_limit, neighbours_deviation, noise_of_bends, resolution, runs
from deatwin.plant.arguments import taking
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording, label

_SEGMENTS = 20  # segments whose means are tested for a trend and a drift
_NEIGHBOURHOOD = 101  # samples over which the usual deviation of a reading is determined
_RINGING = 10  # samples beside an outlier in which no other reading deviates, and samples that ringing may last
_LINEAR = 0.95  # share of the deviations of readings that may remain without a linear answer to the inputs
FEWEST = 200  # samples below which nothing can be distinguished from chance


class FindingKind(Enum):
    """Kind of irregularity in a recording. The value of each member is advice to the user."""

    TREND = "include a slow input or time in the model, or fit a stationary section"
    DRIFT = "fit a stationary section, or let parameters vary in time"
    OUTLIERS = "inspect these samples; leave them out if the reading was disturbed"
    QUANTISATION = "the noise is not normal and not white: use a finer range"
    CLIPPING = "leave these samples out, or model the limit"
    FEW_LEVELS = "let the input take more levels, or keep its powers in the model below their number"
    CONSTANT = "the reading was stuck or the channel lost: leave the stretch out"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Irregularity in a recording that should be examined before a model is fitted.

    Parameters
    ----------
    kind : FindingKind
        Kind of the irregularity.
    recording : str
        Name of the recording.
    signal : str
        Name of the input or output.
    from_s, to_s : float
        First and last time concerned, on the recording's clock, in s.
    size : float
        Size of the irregularity in the signal's unit. Trend: total change. Drift: largest deviation from the trend.
        Outliers: largest deviation from the neighbours. Quantisation: step. Clipping and constant readings: the value
        that repeats. Few levels: range of the input.
    unit : str
        Unit of the signal.
    count : int
        Number of samples concerned. Few levels: number of levels.
    text : str
        Description of the irregularity.
    """

    kind: FindingKind
    recording: str
    signal: str
    from_s: float
    to_s: float
    size: float
    unit: str
    count: int
    text: str

    def __str__(self) -> str:
        return f"{self.recording}, {self.signal}: {self.text}"


@taking(degree=whole_number)
def inspect_recordings(recordings: Recordings, *, level: float = 0.01, degree: int = 3) -> tuple[Finding, ...]:
    """Look for trends, drift, outliers, quantisation, clipping, constant readings and inputs with few levels.

    The recordings are not altered. Inputs are examined for trends, drift and few levels only, because a command may
    jump, rest or stay at a limit. Trends and drift are reported only if the recording lasts at least 300 correlation
    times of the signal; in shorter recordings they cannot be distinguished from chance. Only isolated readings count as
    outliers, because a group of deviating readings could be motion.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings of at least 200 samples each.
    level : float
        Significance level: probability that a signal of normal noise gives a false finding of a given kind.
    degree : int
        Largest degree of the intended model. An input is reported if it does not have more levels than this degree,
        because it then cannot determine the model.

    Returns
    -------
    tuple of Finding
        Findings in the order of recordings, signals and kinds; empty if there are none.

    Raises
    ------
    DataError
        If a recording has fewer than 200 samples, or `level` does not lie between 0 and 1.
    """
    if not 0.0 < real_number(level, "level") < 1.0:
        raise DataError(f"level = {level}; it must lie between 0 and 1")
    found: list[Finding] = []
    chosen = flatten(recordings)
    few = input_levels(chosen, degree)
    for record in chosen:
        if record.n_samples < FEWEST:
            raise DataError(f"{label(record)}: {record.n_samples} samples are too few to look at; {FEWEST} are needed")
        found += _of_record(record, level, few)
    return tuple(found)


def _of_record(record: Recording, level: float, few: Mapping[int, Array]) -> Iterator[Finding]:
    for row, (name, unit) in enumerate(zip(record.input_names, record.input_units, strict=True)):
        channel = _Channel(record, name, unit, record.inputs[row])
        if np.ptp(channel.values) > 0.0:
            yield from _slow(channel, level)
        if row in few:
            text = said_of_levels(name, few[row].size)
            every, span = np.arange(channel.values.size), float(np.ptp(few[row]))
            yield replace(channel.finding(FindingKind.FEW_LEVELS, every, span, text), count=few[row].size)
    span = np.ptp(record.inputs, axis=1, keepdims=True)
    moves = record.inputs / np.where(span > 0.0, span, np.inf)  # as shares of their ranges
    for row, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        channel = _Channel(record, name, unit, record.outputs[row])
        if np.ptp(channel.values) > 0.0:
            yield from _slow(channel, level)
            yield from _outliers(channel, level)
            yield from _quantisation(channel)
            yield from _clipping(channel)
        yield from _constant(channel, moves, level)


@dataclass(frozen=True, eq=False)
class _Channel:
    """One signal of a recording."""

    record: Recording
    name: str
    unit: str
    values: Array

    def finding(self, kind: FindingKind, where: NDArray[np.intp], size: float, text: str) -> Finding:
        """Return a finding about some samples."""
        times = self.record.timepts
        return Finding(
            kind=kind,
            recording=label(self.record),
            signal=self.name,
            from_s=float(times[where[0]]),
            to_s=float(times[where[-1]]),
            size=float(size),
            unit=self.unit,
            count=int(where.size),
            text=text,
        )

    def amount(self, value: float) -> str:
        """Write a value with its unit."""
        return with_unit(value, self.unit)


def _slow(channel: _Channel, level: float) -> Iterator[Finding]:
    """Find a linear trend, and drift of segment means beyond it where segments are long against the memory."""
    from scipy.special import fdtrc, stdtr

    y = channel.values
    segments = cut(y, _SEGMENTS)
    length = segments.shape[1]
    # Each segment is detrended, because a larger trend would otherwise simulate a longer correlation.
    if length < ENOUGH_CORRELATION_TIMES * correlation_samples(_levelled(segments)):
        return
    means = segments.mean(axis=1)
    time, dof = np.arange(_SEGMENTS) - (_SEGMENTS - 1) / 2, _SEGMENTS - 2
    slope = float(time @ means) / float(time @ time)
    left = means - means.mean() - slope * time
    floor = (1e-9 * float(np.abs(y).max())) ** 2  # rounding is no drift
    spread, chance = max(float(left @ left) / dof, floor), max(float(chance_of_mean(segments).mean()), floor)
    t_value = slope / np.sqrt(spread / float(time @ time))
    total, duration = slope * y.size / length, channel.record.duration
    if 2.0 * float(stdtr(dof, -abs(t_value))) < level:
        text = (
            f"a linear trend of {channel.amount(total)} over {duration:.4g} s, which is "
            f"{abs(total) / float(y.std()):.2g} standard deviations of the signal (significance: t = {t_value:.1f} with "
            f"{dof} degrees of freedom)"
        )
        yield channel.finding(FindingKind.TREND, np.arange(y.size), total, text)
    if float(fdtrc(dof, 2 * _SEGMENTS, spread / chance)) < level:
        worst = int(np.argmax(np.abs(left)))
        where = np.arange(worst * length, (worst + 1) * length)
        text = (
            f"a slow drift: means over {duration / _SEGMENTS:.3g} s vary by {channel.amount(np.sqrt(spread))} rms, where "
            f"chance alone gives {channel.amount(np.sqrt(chance))} rms; the largest deviation is "
            f"{channel.amount(left[worst])}, from {channel.record.timepts[where[0]]:.4g} s on"
        )
        yield channel.finding(FindingKind.DRIFT, where, left[worst], text)


def _levelled(segments: Array) -> Array:
    """Subtract from each segment its straight line, shape (n_segments, n)."""
    time = np.arange(segments.shape[1]) - (segments.shape[1] - 1) / 2
    slopes = segments @ time / (time @ time)
    return np.asarray(segments - slopes[:, None] * time, dtype=np.float64)


def _outliers(channel: _Channel, level: float) -> Iterator[Finding]:
    """Find isolated readings far from their neighbours, in the readings and in what a linear system leaves of them."""
    y = channel.values
    rest = y - _answer(channel.record, y)
    # The answer to the inputs hides disturbed readings. If it is not linear, the rest has corners that are no outliers.
    linear = np.abs(neighbours_deviation(rest)).sum() < _LINEAR * np.abs(neighbours_deviation(y)).sum()
    looked_at = [_isolated(channel.record, values, level) for values in ((y, rest) if linear else (y,))]
    ratio = np.max([ratios for _, ratios in looked_at], axis=0)
    far = np.flatnonzero(ratio)
    if far.size:
        worst = far[np.argmax(ratio[far])]
        deviation = max(looked_at, key=lambda one: float(one[1][worst]))[0][worst]
        times = ", ".join(f"{channel.record.timepts[k]:.6g}" for k in far[:5]) + (", ..." if far.size > 5 else "")
        text = (
            f"{far.size} outlying reading{'s' if far.size > 1 else ''}, at {times} s; the largest differs from its "
            f"neighbours by {channel.amount(deviation)}, {ratio[worst]:.3g} times the usual difference"
        )
        yield channel.finding(FindingKind.OUTLIERS, far, deviation, text)


def _isolated(record: Recording, values: Array, level: float) -> tuple[Array, Array]:
    """Return the deviation of each value from its neighbours, in usual ones; 0 for motion. Shapes: (n,)."""
    from scipy.ndimage import maximum_filter, median_filter
    from scipy.special import ndtri

    inner = np.arange(2, values.size - 2)
    deviation, jump = neighbours_deviation(values), np.zeros(values.size)
    jump[inner] = np.abs(values[inner + 1] - values[inner - 1])
    size = np.abs(deviation)
    # The usual deviation nearby where the signal moves fast, that of the whole signal elsewhere.
    usual = 1.4826 * np.maximum(median_filter(size, _NEIGHBOURHOOD, mode="nearest"), np.median(size[inner]))
    usual = np.maximum(usual, max(resolution(values) / 2.0, 1e-12 * float(np.abs(values).max())))
    # Bonferroni's correction over the samples; the median of n correlated deviations is uncertain by about 2 / sqrt(n).
    limit = -float(ndtri(level / (2.0 * values.size))) * (1.0 + 2.0 / np.sqrt(values.size))
    # The outlier itself bends the cubics of its neighbours up to two samples away; farther off, nothing may deviate
    # with it.
    around = np.abs(np.arange(-_RINGING, _RINGING + 1)) > 2
    company = maximum_filter(size, footprint=around)
    lone = (size >= maximum_filter(size, 5)) & (size > 2.0 * company) & (size > 2.0 * jump)
    answers = _kinks(record)
    if answers.any():  # Deviations that most kinks cause are usual after a kink.
        usual[answers] = np.maximum(usual[answers], np.quantile(size[answers], 0.95))
    far = np.flatnonzero((size > limit * usual) & lone)
    far = far[~_recurs(far, deviation, record)] if far.size else far
    ratio = np.zeros(values.size)
    ratio[far] = size[far] / usual[far]
    return deviation, ratio


def _answer(record: Recording, output: Array) -> Array:
    """Return what the inputs cause in an output within the samples that ringing may last (n,), as a linear system."""
    n = output.size
    lagged = [np.r_[np.full(lag, u[0]), u[: n - lag]] for u in record.inputs for lag in range(_RINGING + 1)]
    if not lagged:
        return np.zeros(n)
    bends = np.column_stack([neighbours_deviation(one) for one in lagged])
    gains = np.linalg.lstsq(bends, neighbours_deviation(output), rcond=1e-6)[0]
    return np.asarray(gains @ lagged, dtype=np.float64)


def _recurs(samples: NDArray[np.intp], deviation: Array, record: Recording) -> NDArray[np.bool_]:
    """Return at which samples most of a deviation recurs a period of the inputs before or after."""
    periods = {whole_period_of(u) for u in record.inputs if np.ptp(u) > 0.0}
    found = np.zeros(samples.size, dtype=bool)
    if len(periods) == 1 and (period := periods.pop()) is not None:
        for other in (samples - period, samples + period):
            inside = (other >= 0) & (other < deviation.size)
            found[inside] |= deviation[other[inside]] / deviation[samples[inside]] > 0.5
    return found


def _kinks(record: Recording) -> NDArray[np.bool_]:
    """Return samples up to ten after an unusual bend of an input."""
    found = np.zeros(record.n_samples, dtype=bool)
    for u in record.inputs:
        bend = np.abs(np.diff(u, n=2, prepend=u[:1], append=u[-1:]))
        for k in np.flatnonzero(bend > 5.0 * 1.4826 * np.median(bend)):
            found[k : k + _RINGING] = True
    return found


def _quantisation(channel: _Channel) -> Iterator[Finding]:
    """Report a step between readings that adds a tenth or more to the variance of their fast part."""
    y = channel.values
    step, noise = resolution(y), noise_of_bends(y)
    if step**2 / 12.0 > 0.1 * noise**2:
        beside = f"the noise is {channel.amount(noise)} rms" if noise else "they hide the noise"
        text = f"the readings are rounded to steps of {channel.amount(step)} ({np.unique(y).size} different values); {beside}"
        yield channel.finding(FindingKind.QUANTISATION, np.arange(y.size), step, text)


def _clipping(channel: _Channel) -> Iterator[Finding]:
    """Report three or more successive readings at the largest or smallest value."""
    y = channel.values
    for word, rows in at_limit(y).items():
        where = np.concatenate(rows)
        level = y[where[0]]
        yield channel.finding(
            FindingKind.CLIPPING,
            where,
            level,
            f"{where.size} readings between {channel.record.timepts[where[0]]:.6g} and "
            f"{channel.record.timepts[where[-1]]:.6g} s are clipped: in {len(rows)} stretch{'es' if len(rows) > 1 else ''} "
            f"they stay at the {word} value, {channel.amount(level)}",
        )


def _constant(channel: _Channel, moves: Array, level: float) -> Iterator[Finding]:
    """Report equal readings for longer than the resolution explains while an input moves."""
    y = channel.values
    same = np.diff(y) == 0.0
    share = float(same.mean())
    if share == 1.0:
        yield channel.finding(
            FindingKind.CONSTANT, np.arange(y.size), y[0], f"the reading is {channel.amount(y[0])} throughout"
        )
        return
    # With independent equal neighbours, a run of m is expected n share^m times.
    longest = 3 if share == 0.0 else max(3, int(np.ceil(log(level / y.size) / log(share))))
    extremes = (y.min(), y.max())
    for run in runs(same):
        where = np.r_[run, run[-1] + 1]
        if (
            run.size >= longest
            and y[where[0]] not in extremes
            and np.ptp(moves[:, where], axis=1).max(initial=0.0) > 0.02
        ):
            yield channel.finding(
                FindingKind.CONSTANT,
                where,
                y[where[0]],
                f"the reading stays at {channel.amount(y[where[0]])} for {where.size} samples, "
                f"{channel.record.timepts[where[0]]:.6g} to {channel.record.timepts[where[-1]]:.6g} s, "
                "while the input moves",
            )
