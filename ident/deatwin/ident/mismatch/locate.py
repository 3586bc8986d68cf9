"""Where is the mismatch: when, at which frequencies, in which operating region."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch
from scipy.stats import chi2, norm

__all__ = ["Band", "Region", "Track", "Window", "locate_frequency", "locate_region", "locate_time"]

FALSE_DISCOVERIES = 0.05
WINDOW_SECONDS = 2.0
SEGMENT_SECONDS = 20.0
BINS = 12
MOST_PIECES = 5
LOUD = 2.0
"""A line of the spectrum counts when it has this many times the power of the sensor's noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The residual of one record and the signals that may go with it.

    Parameters
    ----------
    timepts : ndarray, shape (n,)
        On the running clock, s.
    residual : ndarray, shape (n,)
        Measured minus simulated, SI.
    signals : mapping of str to ndarray, each of shape (n,)
        Operating signals, in the units in which they are reported.
    sample_time : float
        s.
    """

    timepts: np.ndarray
    residual: np.ndarray
    signals: Mapping[str, np.ndarray]
    sample_time: float


@dataclass(frozen=True, kw_only=True)
class Window:
    """A stretch of the clock.

    Parameters
    ----------
    from_s, to_s : float
        Clock times, s.
    score : float
        Its share of the mismatch's energy.
    """

    from_s: float
    to_s: float
    score: float


@dataclass(frozen=True, kw_only=True)
class Band:
    """A band of frequencies whose spectrum lies above the floor.

    Parameters
    ----------
    from_Hz, to_Hz : float
        Ends of the band.
    excess_dB : float
        Mean power over that of the sensor's noise.
    """

    from_Hz: float
    to_Hz: float
    excess_dB: float


@dataclass(frozen=True, kw_only=True)
class Region:
    """A range of an operating signal in which the residual has a mean.

    Parameters
    ----------
    signal : str
        Name of the signal.
    low, high : float
        Ends of the range, in the signal's unit.
    mean_residual : float
        In the report's unit.
    """

    signal: str
    low: float
    high: float
    mean_residual: float


def locate_time(tracks: Sequence[Track], floor: float) -> tuple[Window, ...]:
    """Stretches of time that hold the mismatch, cut where the residual's level or size changes.

    The residual is taken in windows of two seconds; dynamic programming cuts the sequence of their means and
    log-powers into pieces of constant level, with a penalty of twice the logarithm of the number of windows for
    each level (Schwarz), raised until at most five pieces are left in a record: a residual that varies all the
    time has no onset. Pieces whose mean square exceeds the floor are reported.

    Parameters
    ----------
    tracks : sequence of Track
        One for each record.
    floor : float
        Mean square that noise and model error account for, SI.

    Returns
    -------
    tuple of Window
        In order of time; their scores add up to one.

    References
    ----------
    Killick, Fearnhead & Eckley, J. Am. Stat. Assoc. 107 (2012) 1590, doi:10.1080/01621459.2012.737745 (optimal
    partitioning, eq. 3).
    """
    pieces: list[tuple[float, float, float]] = []
    for track in tracks:
        size = max(2, min(round(WINDOW_SECONDS / track.sample_time), track.residual.size // 8))
        count = track.residual.size // size
        windows = track.residual[: count * size].reshape(count, size)
        features = np.stack([windows.mean(axis=1), np.log(np.mean(windows**2, axis=1) + 1e-300)])
        edges = _few_change_points(features)
        for first, last in itertools.pairwise(edges):
            stop = track.residual.size if last == count else last * size
            excess = float(np.mean(track.residual[first * size : stop] ** 2) - floor)
            if excess > 0:
                begin = float(track.timepts[first * size])
                pieces.append((begin, float(track.timepts[stop - 1]) + track.sample_time, excess))
    energy = sum((end - begin) * excess for begin, end, excess in pieces)
    return tuple(Window(from_s=b, to_s=e, score=float((e - b) * x / energy)) for b, e, x in pieces)


def _few_change_points(features: np.ndarray) -> list[int]:
    penalty = 2 * features.shape[0] * np.log(features.shape[1])
    edges = _change_points(features, penalty)
    while len(edges) > MOST_PIECES + 1:
        penalty *= 2
        edges = _change_points(features, penalty)
    return edges


def _change_points(features: np.ndarray, penalty: float) -> list[int]:
    """Optimal partition of rows of features into pieces of constant mean."""
    # Differences of neighbours estimate the scatter without the levels.
    scatter = np.median(np.abs(np.diff(features, axis=1)), axis=1) / (0.6745 * np.sqrt(2)) + 1e-300
    standard = features / scatter[:, None]
    n = standard.shape[1]
    sums = np.concatenate([np.zeros((standard.shape[0], 1)), np.cumsum(standard, axis=1)], axis=1)
    squares = np.concatenate([[0.0], np.cumsum((standard**2).sum(axis=0))])
    best = np.full(n + 1, np.inf)
    best[0] = -penalty
    before = np.zeros(n + 1, dtype=int)
    for last in range(1, n + 1):
        first = np.arange(last)
        means = (sums[:, [last]] - sums[:, first]) ** 2 / (last - first)
        cost = best[first] + squares[last] - squares[first] - means.sum(axis=0) + penalty
        before[last] = int(np.argmin(cost))
        best[last] = cost[before[last]]
    edges = [n]
    while edges[-1] > 0:
        edges.append(int(before[edges[-1]]))
    return edges[::-1]


def locate_frequency(tracks: Sequence[Track], noise: float) -> tuple[Band, ...]:
    """Bands in which the residual's spectrum lies above white sensor noise.

    Welch's estimate over segments of twenty seconds, averaged over records; each line is tested against the
    chi-squared law of an averaged periodogram, with the false-discovery rate held at 5 % over all lines, and must
    have at least twice the power of the noise.

    Parameters
    ----------
    tracks : sequence of Track
        One for each record.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    tuple of Band
        Neighbouring lines joined; in order of frequency.

    References
    ----------
    Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70, doi:10.1109/TAU.1967.1161901; Benjamini & Hochberg,
    J. R. Stat. Soc. B 57 (1995) 289, doi:10.1111/j.2517-6161.1995.tb02031.x.
    """
    step = tracks[0].sample_time
    segment = min(round(SEGMENT_SECONDS / step), min(track.residual.size for track in tracks))
    total: np.ndarray | float = 0.0
    segments = 0
    frequency = np.empty(0)
    for track in tracks:
        count = max(1, 2 * track.residual.size // segment - 1)
        frequency, density = welch(track.residual, 1 / step, nperseg=segment, detrend=False)
        total = total + count * density
        segments += count
    ratio = np.asarray(total) / segments / (2 * noise**2 * step)
    ratio[0] *= 2  # a one-sided spectrum counts the mean and the Nyquist line once
    ratio[-1] *= 2
    # Neighbouring half-overlapping Hann segments correlate by 1/6, so many are worth 1/(1 + 2/36) of as many.
    degrees = 2 * max(1.0, segments * 18 / 19)
    lines = np.flatnonzero(_discoveries(chi2.sf(ratio * degrees, degrees)) & (ratio > LOUD))
    width = frequency[1]
    bands = []
    for run in _runs(lines):
        bands.append(
            Band(
                from_Hz=float(max(0.0, frequency[run[0]] - width / 2)), to_Hz=float(frequency[run[-1]] + width / 2),
                excess_dB=float(10 * np.log10(np.mean(ratio[run]))),
            )
        )
    return tuple(bands)


def locate_region(tracks: Sequence[Track], unit: float) -> tuple[Region, ...]:
    """Ranges of the operating signals in which the residual's mean is not zero.

    Each signal is cut into bins of equal counts; the mean over a bin is tested with one independent value a
    second, and the false-discovery rate is held at 5 % over all bins of all signals.

    Parameters
    ----------
    tracks : sequence of Track
        One for each record.
    unit : float
        SI size of the unit in which `mean_residual` is given.

    Returns
    -------
    tuple of Region
        Neighbouring bins whose means have one sign joined; the largest mean first.
    """
    residual = np.concatenate([t.residual for t in tracks]) / unit
    # Clocks of several experiments overlap: seconds of different records are different seconds.
    seconds = np.concatenate([np.floor(t.timepts) + 1e9 * k for k, t in enumerate(tracks)])
    found = []
    for signal in tracks[0].signals:
        values = np.concatenate([t.signals[signal] for t in tracks])
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
        if edges.size < 3:
            continue
        index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
        for number in range(edges.size - 1):
            inside = index == number
            mean, p = _mean_test(residual[inside], seconds[inside])
            found.append((signal, number, float(edges[number]), float(edges[number + 1]), mean, int(inside.sum()), p))
    passed = _discoveries(np.array([row[-1] for row in found]))
    regions: list[Region] = []
    last, weight = ("", -2), 0
    for (signal, number, low, high, mean, count, _), good in zip(found, passed, strict=True):
        if not good:
            continue
        joins = last == (signal, number - 1) and regions[-1].mean_residual * mean > 0
        if joins:
            merged = regions.pop()
            mean = (weight * merged.mean_residual + count * mean) / (weight + count)
            low = merged.low
            count += weight
        regions.append(Region(signal=signal, low=low, high=high, mean_residual=mean))
        last, weight = (signal, number), count
    return tuple(sorted(regions, key=lambda r: -abs(r.mean_residual)))


def _mean_test(values: np.ndarray, seconds: np.ndarray) -> tuple[float, float]:
    """Mean, and its two-sided p-value from the scatter of the means of whole seconds."""
    _, inverse = np.unique(seconds, return_inverse=True)
    means = np.bincount(inverse, weights=values) / np.bincount(inverse)
    if means.size < 3:
        return float(values.mean()), 1.0
    deviation = means.std(ddof=1) / np.sqrt(means.size) + 1e-300
    return float(values.mean()), float(2 * norm.sf(abs(means.mean()) / deviation))


def _discoveries(p_values: np.ndarray) -> np.ndarray:
    """Which hypotheses Benjamini and Hochberg's step-up procedure rejects."""
    order = np.argsort(p_values)
    limits = FALSE_DISCOVERIES * np.arange(1, p_values.size + 1) / p_values.size
    below = np.flatnonzero(p_values[order] <= limits)
    rejected = np.zeros(p_values.size, dtype=bool)
    if below.size:
        rejected[order[: below[-1] + 1]] = True
    return rejected


def _runs(lines: np.ndarray) -> list[np.ndarray]:
    """Consecutive integers, in groups; a gap of one line does not part a group."""
    return [run for run in np.split(lines, np.flatnonzero(np.diff(lines) > 2) + 1) if run.size]
