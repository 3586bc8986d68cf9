"""Choose training and validation sections: stretches of recordings that pass tests for trend, change and spread.

For a model of constant parameters, mean, variance and fast power must stay: means over a segment of y, (y - mean)^2 and
(y(k) - y(k-1))^2 (Bendat and Piersol, Random Data, 4th ed., 2010, sections 4.5.2 and 10.3.1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache, partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from deatwin.ident.arguments import real_number, whole_number
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.arguments import taking
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import (
    Described,
    Metadata,
    Variables,
    attribute,
    columns,
    coordinate,
    several,
    status_of,
    table_along,
    variable,
)
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording, label

STATISTICS = ("mean", "variance", "fast variance")
ENOUGH_CORRELATION_TIMES = 15.0  # Length of a segment, in correlation times, from which on the tests keep their level
_SMALLEST_GROUP = 3  # least segments before or after a change


@dataclass(frozen=True, eq=False)
class SegmentMeans:
    """Statistic of each segment with its sampling variance."""

    values: Array
    chance: Array

    def part(self, first: int, last: int) -> SegmentMeans:
        """Return the segments ``first`` to ``last - 1``."""
        return SegmentMeans(self.values[first:last], self.chance[first:last])


def segment_means(signal: Array, n_segments: int) -> tuple[SegmentMeans, ...]:
    """Return the statistics of the segments of a signal, in the order of `STATISTICS`. Shapes: `signal` (n,)."""
    segments = cut(signal, n_segments)
    mean = segments.mean(axis=1, keepdims=True)
    squares = (segments - mean) ** 2, np.diff(segments, axis=1) ** 2
    return (SegmentMeans(mean[:, 0], chance_of_mean(segments)), *(_relative(square) for square in squares))


def _relative(square: Array) -> SegmentMeans:
    """Return three times the cube root (Wilson and Hilferty): nearly normal, with the mean's relative variance."""
    power = square.mean(axis=1, keepdims=True)
    power = np.maximum(power, np.finfo(float).eps * max(float(power.max()), np.finfo(float).tiny))
    return SegmentMeans(3.0 * np.cbrt(power[:, 0] / power.mean()), chance_of_mean(square / power))


def cut(signal: Array, n_segments: int) -> Array:
    """Cut a signal (n,) into complete segments, shape (n_segments, length)."""
    length = signal.size // n_segments
    return signal[: n_segments * length].reshape(n_segments, length)


def chance_of_mean(segments: Array) -> Array:
    """Return the variance of each segment's mean, (n_segments,), from its lowest periodogram line."""
    length = segments.shape[1]
    slowest = np.fft.rfft(segments, axis=1)[:, 1]
    return np.asarray(np.abs(slowest) ** 2 / length**2, dtype=np.float64)


def correlation_samples(segments: Array) -> float:
    """Return the integral time scale within segments (n_segments, length), in samples, up to the first zero."""
    length = segments.shape[1]
    left = segments - segments.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(left, 2 * length, axis=1)) ** 2
    products = np.fft.irfft(power.mean(axis=0))[:length]
    if products[0] <= 0.0:
        return 0.0
    correlation = products / products[0] * length / np.arange(length, 0, -1)
    zero = int(np.argmax(correlation <= 0.0)) or length
    return 1.0 + 2.0 * float(correlation[1:zero].sum())


def trend_p_value(data: SegmentMeans) -> float:
    """Return the two-sided p-value of the reverse arrangements, exact for independent values of any distribution."""
    values = data.values
    larger = (np.sign(values[:, None] - values[None, :]) + 1.0) / 2.0  # a tie counts half
    count = float(np.sum(np.triu(larger, k=1)))
    law = _inversion_law(values.size)
    mean = values.size * (values.size - 1) / 4
    return float(law[np.abs(np.arange(law.size) - mean) >= abs(count - mean) - 1e-9].sum())


def change_p_value(data: SegmentMeans) -> float:
    """Return the p-value of the largest difference of segments before and after a time (t test, Bonferroni)."""
    from scipy.special import stdtr

    n = data.values.size
    cuts = np.arange(_SMALLEST_GROUP, n - _SMALLEST_GROUP + 1)
    before = np.cumsum(data.values)[cuts - 1] / cuts
    after = (data.values.sum() - before * cuts) / (n - cuts)
    between = (before - after) ** 2 * cuts * (n - cuts) / n
    within = np.maximum(data.values.var() * n - between, np.finfo(float).tiny)
    ratio = np.sqrt(between / (within / (n - 2)))
    return min(1.0, 2 * float(stdtr(n - 2, -ratio.max())) * cuts.size)


def spread_p_value(data: SegmentMeans) -> float:
    """Return the p-value of the variance of the values relative to their sampling variance (F test)."""
    from scipy.special import fdtrc

    n = data.values.size
    ratio = data.values.var(ddof=1) / max(float(data.chance.mean()), np.finfo(float).tiny)
    return float(fdtrc(n - 1, 2 * n, ratio))


TESTS: Mapping[str, Callable[[SegmentMeans], float]] = MappingProxyType(
    {"trend": trend_p_value, "change": change_p_value, "spread": spread_p_value}
)


@lru_cache(maxsize=64)
def _inversion_law(n: int) -> Array:
    """Return the probabilities of 0, 1, ... inversions of a random permutation of n."""
    law = np.ones(1)
    for k in range(2, n + 1):
        law = np.convolve(law, np.full(k, 1.0 / k))
    law.setflags(write=False)
    return law


Statistics = dict[str, tuple[SegmentMeans, ...]]
_FEWEST_SEGMENTS = 10  # with fewer segments, no order of them is improbable enough to be called non-stationary


class SectionStatus(Enum):
    """Basis on which `choose_sections` chose the sections. The value of each member is a message for the user."""

    STATIONARY = "whole recordings pass the test of stationarity"
    PART = "only a part of the recordings passes the test; the table lists the excluded segments"
    NOTHING = (
        "no stretch passes the test: the sections are the halves of the longest recording, "
        "and a model with constant parameters may be wrong"
    )


@dataclass(frozen=True, kw_only=True)
class StationarityTest:
    """Result of one test of stationarity, for one statistic of one signal.

    Parameters
    ----------
    signal : str
        Name of the input or output.
    statistic : str
        Statistic that is computed for each segment: "mean", "variance", or "fast variance", which is the mean squared
        difference between successive samples.
    test : str
        Property that is tested over the segments: a "trend" of the statistic, a "change" at one time, or a "spread"
        that is larger than chance allows.
    p_value : float
        Probability of a test result at least as extreme if the signal is stationary and its segments are independent.
    """

    signal: str
    statistic: str
    test: str
    p_value: float


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Consecutive segments of a recording that passed the tests of `choose_sections`.

    Parameters
    ----------
    record : int
        Index of the recording, from 0.
    first, last : int
        Index of the first sample of the stretch, and index of the first sample after the stretch.
    p_value : float
        Smallest p-value of all tests, multiplied by the number of tests (Bonferroni); at most 1.
    """

    record: int
    first: int = field(metadata=variable(unit="samples"))
    last: int = field(metadata=variable(unit="samples"))
    p_value: float

    @property
    def n_samples(self) -> int:
        """Length of the stretch in samples."""
        return self.last - self.first


def _test_table(found: Sections) -> Variables:
    return columns(
        "test",
        [
            {"record": number, "signal": t.signal, "statistic": t.statistic, "kind": t.test, "p_value": t.p_value}
            for number, each in enumerate(found.tests)
            for t in each
        ],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sections(Described):
    """Sections for training and validation, with the tests that led to them.

    Parameters
    ----------
    recordings : tuple of Recording
        Recordings that were examined.
    training, validation : Recording
        Chosen sections; their times refer to the clock of the recordings.
    stretches : tuple of Stretch
        Stretches that passed the tests, longest first.
    tests : tuple of tuple of StationarityTest
        Tests of each whole recording.
    segment_s : tuple of float
        Length of the segments of each recording, in s.
    correlation_time_s : tuple of float
        Longest correlation time of any signal of each recording, in s. Segments should be at least 15 times as long.
        If they are only 10 times as long, a stationary stretch fails with twice the probability ``level``.
    level : float
        Probability that a stationary stretch fails at least one of the tests (Bonferroni).
    status : SectionStatus
        Basis of the choice.
    """

    recordings: tuple[Recording, ...]
    training: Recording
    validation: Recording
    stretches: tuple[Stretch, ...] = field(metadata=table_along("stretch"))
    tests: tuple[tuple[StationarityTest, ...], ...]
    segment_s: tuple[float, ...] = field(
        metadata=variable("record", name="segment", unit="s", about="length of a segment")
    )
    correlation_time_s: tuple[float, ...] = field(
        metadata=variable("record", name="correlation_time", unit="s", about="longest within the segments")
    )
    level: float = field(metadata=attribute())
    status: SectionStatus = field(metadata=status_of())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "tests": several(_test_table),
        "section": coordinate("section", of=lambda _: ["training", "validation"]),
        "section_start": variable("section", of=lambda found: [found.training.start, found.validation.start], unit="s"),
        "section_end": variable("section", of=lambda found: [found.training.end, found.validation.end], unit="s"),
        "section_n_samples": variable(
            "section", of=lambda found: [found.training.n_samples, found.validation.n_samples]
        ),
        "record_start": variable("record", of=lambda found: [one.start for one in found.recordings], unit="s"),
        "record_end": variable("record", of=lambda found: [one.end for one in found.recordings], unit="s"),
        "segments_are_long": attribute(),
    }

    @property
    def segments_are_long(self) -> bool:
        """True if the segments of every recording are at least 15 correlation times long, as the tests require."""
        pairs = zip(self.segment_s, self.correlation_time_s, strict=True)
        return all(segment >= ENOUGH_CORRELATION_TIMES * correlation for segment, correlation in pairs)

    def __str__(self) -> str:
        lines = [
            f"{kind}: {section.start:.6g} to {section.end:.6g} s ({section.n_samples} samples)"
            for kind, section in (("training", self.training), ("validation", self.validation))
        ]
        for number, (record, tests) in enumerate(zip(self.recordings, self.tests, strict=True), start=1):
            worst = min(tests, key=lambda one: one.p_value)
            total = min(1.0, worst.p_value * len(tests))
            verdict = "passes" if total >= self.level else "fails"
            lines.append(
                f"recording {number}, {record.start:.6g} to {record.end:.6g} s: {verdict} as a whole, p = {total:.3g} "
                f"({worst.statistic} of {worst.signal}, {worst.test})"
            )
        if not self.segments_are_long:
            lines.append("the segments are short compared with the correlation time: use fewer segments")
        return "\n".join([*lines, self.status.value])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the first output of the recordings with the two sections marked, on `ax` or new axes."""
        axes = axes_or_new(ax)
        for record in self.recordings:
            axes.plot(record.timepts, record.outputs[0], color="0.4", linewidth=0.6)
        for section, colour, use in (
            (self.training, "tab:blue", "training"),
            (self.validation, "tab:orange", "validation"),
        ):
            axes.axvspan(section.start, section.end, color=colour, alpha=0.25, linewidth=0, label=use)
        record = self.recordings[0]
        axes.set(xlabel="time (s)", ylabel=axis_label(record.output_names[0], record.output_units[0]))
        axes.legend(loc="upper right")
        return axes


@taking(n_segments=partial(whole_number, least=0))
def choose_sections(
    recordings: Recordings, *, n_segments: int = 20, level: float = 0.05, validation_share: float = 0.3
) -> Sections:
    """Choose training and validation sections by a test of stationarity.

    Each recording is cut into segments. The longest run of at least ten segments that passes all tests is a stationary
    stretch. Its first and last segments are dropped unless the recording begins or ends there. Further stretches are
    sought in the remaining segments.

    The longest stretch is used for training. The second longest is used for validation if it is long enough for
    `validation_share`; otherwise the end of the longest stretch is used. If there is no stationary stretch, the
    sections are the halves of the longest recording.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings to choose from.
    n_segments : int
        Number of segments of each recording, at least 10.
    level : float
        Probability that a stationary stretch fails at least one of the tests (Bonferroni).
    validation_share : float
        Share of the validation section in the samples of both sections, between 0 and 1.

    Raises
    ------
    DataError
        If there are fewer than 10 segments, a segment has fewer than 8 samples, all signals of a recording are
        constant, or `level` or `validation_share` does not lie between 0 and 1.
    """
    shares = real_number(level, "level"), real_number(validation_share, "validation_share")
    if not all(0.0 < share < 1.0 for share in shares):
        raise DataError(f"level = {level} and validation_share = {validation_share} must lie between 0 and 1")
    chosen = flatten(recordings)
    statistics = [_statistics(record, n_segments) for record in chosen]
    stretches = sorted(
        (
            stretch
            for number, (record, each) in enumerate(zip(chosen, statistics, strict=True))
            for stretch in _stretches(number, record, each, n_segments, level)
        ),
        key=lambda one: -one.n_samples,
    )
    training, validation = _divide(chosen, stretches, validation_share)
    whole = [stretch.n_samples for stretch in stretches if stretch.n_samples == chosen[stretch.record].n_samples]
    return Sections(
        recordings=chosen,
        training=training,
        validation=validation,
        stretches=tuple(stretches),
        tests=tuple(_tests(record, each) for record, each in zip(chosen, statistics, strict=True)),
        segment_s=tuple((r.n_samples // n_segments) * r.sample_time for r in chosen),
        correlation_time_s=tuple(_correlation_time(record, n_segments) for record in chosen),
        level=level,
        status=SectionStatus.NOTHING
        if not stretches
        else SectionStatus.STATIONARY
        if len(whole) == len(chosen)
        else SectionStatus.PART,
    )


def _statistics(recording: Recording, n_segments: int) -> Statistics:
    """Return the statistics of the segments of each moving signal, by its name."""
    length = recording.n_samples // max(n_segments, 1)
    if n_segments < _FEWEST_SEGMENTS or length < 8:
        raise DataError(
            f"{label(recording)}: {recording.n_samples} samples in {n_segments} segments: "
            f"at least {_FEWEST_SEGMENTS} segments of at least 8 samples are needed"
        )
    names = recording.input_names + recording.output_names
    signals = np.concatenate([recording.inputs, recording.outputs])
    return {
        name: segment_means(signal, n_segments)
        for name, signal in zip(names, signals, strict=True)
        if np.ptp(signal) > 0.0
    }


def _tests(recording: Recording, statistics: Statistics) -> tuple[StationarityTest, ...]:
    if not statistics:
        raise DataError("all signals of the recording are constant: there is nothing to test")
    return tuple(
        StationarityTest(signal=name, statistic=statistic, test=test, p_value=p_value(means))
        for name, each in statistics.items()
        for statistic, means in zip(STATISTICS, each, strict=True)
        for test, p_value in TESTS.items()
    )


def _stretches(
    number: int, record: Recording, statistics: Statistics, n_segments: int, level: float
) -> Iterator[Stretch]:
    """Yield stationary stretches that do not overlap, the longest first."""
    length = record.n_samples // n_segments
    free = [(0, n_segments)]
    while free:
        begin, end = max(free, key=lambda gap: gap[1] - gap[0])
        free.remove((begin, end))
        found = _longest(record, statistics, begin, end, level)
        if found is None:
            continue
        first, last, p_value = found
        free += [(begin, first), (last, end)]
        # The cause of the neighbours' failure may begin within the outermost segment.
        first, last = first + (first > 0), last - (last < n_segments)
        yield Stretch(
            record=number,
            first=first * length,
            last=record.n_samples if last == n_segments else last * length,
            p_value=p_value,
        )


def _longest(
    record: Recording, statistics: Statistics, begin: int, end: int, level: float
) -> tuple[int, int, float] | None:
    """Return the longest passing run of segments with its p-value; the first of equally long ones."""
    for count in range(end - begin, _FEWEST_SEGMENTS - 1, -1):
        for first in range(begin, end - count + 1):
            part = {
                name: tuple(means.part(first, first + count) for means in each) for name, each in statistics.items()
            }
            tests = _tests(record, part)
            p_value = min(1.0, len(tests) * min(test.p_value for test in tests))
            if p_value >= level:
                return first, first + count, p_value
    return None


def _divide(recordings: tuple[Recording, ...], stretches: list[Stretch], share: float) -> tuple[Recording, Recording]:
    """Divide stretches into training and validation sections."""
    if not stretches:
        record = max(recordings, key=lambda one: one.n_samples)
        half = record.n_samples // 2
        return record.section(0, half), record.section(half, record.n_samples)
    best, *rest = stretches
    record = recordings[best.record]
    if rest and rest[0].n_samples >= share / (1.0 - share) * best.n_samples:
        other = rest[0]
        return record.section(best.first, best.last), recordings[other.record].section(other.first, other.last)
    cut = best.last - round(share * best.n_samples)
    return record.section(best.first, cut), record.section(cut, best.last)


def _correlation_time(record: Recording, n_segments: int) -> float:
    """Return the longest correlation time of the signals, in s."""
    signals = np.concatenate([record.inputs, record.outputs])
    return max(correlation_samples(cut(signal, n_segments)) for signal in signals) * record.sample_time
