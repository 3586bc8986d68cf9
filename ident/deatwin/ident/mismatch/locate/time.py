"""Location of the mismatch in time, its growth, and whether it returns."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.special import ndtr

from deatwin.ident.mismatch.locate.track import SI, Track, Unit
from deatwin.ident.mismatch.located import Window
from deatwin.ident.mismatch.thresholds import CHANCE, MOST, MOST_WINDOWS, NEARLY_ALL, TINY, WINDOW_SECONDS
from deatwin.ident.soundness import samples_in
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new

MOST_PIECES = 5
FEWEST_SECONDS = 5
"""Length of the shortest window in which a trend can be seen, s."""


def _along(name: str) -> Callable[[Times], np.ndarray]:
    """Join an array of all tracks, one after another."""
    return lambda found: np.concatenate([np.zeros(0), *(getattr(track, name) for track in found.tracks)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Times(Described):
    """The stretches of the clock that hold the mismatch; it iterates over them."""

    windows: tuple[Window, ...] = field(metadata=table_along("window"))  # in order of time
    period_s: float | None = field(metadata=attribute())  # period of the mismatch; None if it is not periodic
    tracks: tuple[Track, ...]  # the residuals, to be drawn

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "residual": variable("sample", of=_along("residual"), about="measured minus simulated, SI"),
        "time": coordinate("sample", of=_along("timepts"), unit="s"),
        "track": coordinate(
            "sample",
            of=lambda found: np.repeat(range(len(found.tracks)), [track.residual.size for track in found.tracks]),
        ),
    }

    def __iter__(self) -> Iterator[Window]:
        return iter(self.windows)

    def __len__(self) -> int:
        return len(self.windows)

    def plot(self, ax: Axes | None = None, *, unit: Unit = SI) -> Axes:
        """Draw the residuals over the clock, the windows shaded by their scores; `unit` is a name and its SI size."""
        ax = axes_or_new(ax)
        name, size = unit
        for track in self.tracks:
            ax.plot(track.timepts, track.residual / size, color="C0", linewidth=0.5)
        for window in self.windows:
            ax.axvspan(window.from_s, window.to_s, color="C1", alpha=0.1 + 0.4 * window.score, linewidth=0)
        ax.set_xlabel("time (s)")
        ax.set_ylabel(f"residual ({name})")
        if self.period_s is not None:
            ax.set_title(f"comes back every {self.period_s:.3g} s", fontsize="medium")
        return ax


def locate_time(tracks: Sequence[Track], floor: float) -> Times:
    """Return stretches of time that hold the mismatch, cut where the residual's level or size changes.

    They exceed `floor`, the mean square that noise and model error account for, SI; their scores add up to one.
    """
    # Windows of two seconds, and of ten samples at least, are cut by dynamic programming into pieces of constant mean
    # and log-power (Killick, Fearnhead & Eckley, J. Am. Stat. Assoc. 107 (2012) 1590, doi:10.1080/01621459.2012.737745,
    # eq. 3). The penalty for each level is twice the logarithm of the number of windows (Schwarz), raised until at most
    # five pieces are left in a record: a residual that varies all the time has no onset. A trend within a piece is
    # tested by whole seconds.
    pieces: list[tuple[float, float, float, float]] = []
    for track in tracks:
        n = track.residual.size
        size = max(2, min(max(samples_in(WINDOW_SECONDS, track.sample_time), n // MOST_WINDOWS), n // 8))
        count = track.residual.size // size
        rows = track.residual[: count * size].reshape(count, size)
        features = np.stack([rows.mean(axis=1), np.log(np.mean(rows**2, axis=1) + TINY)])
        edges = _few_change_points(features)
        for first, last in itertools.pairwise(edges):
            stop = track.residual.size if last == count else last * size
            excess = float(np.mean(track.residual[first * size : stop] ** 2) - floor)
            if excess > 0:
                begin = float(track.timepts[first * size])
                slope = _slope(track, first * size, stop)
                pieces.append((begin, float(track.timepts[stop - 1]) + track.sample_time, excess, slope))
    energy = sum((end - begin) * excess for begin, end, excess, _ in pieces)
    windows = tuple(
        Window(from_s=b, to_s=e, score=float((e - b) * x / energy), slope=slope) for b, e, x, slope in pieces
    )
    return Times(windows=windows, period_s=_period(tracks) if windows else None, tracks=tuple(tracks))


def _slope(track: Track, first: int, stop: int) -> float:
    """Return the trend of the residual in a window, by least squares on means of whole seconds; 0 if not significant."""
    size = max(1, round(1.0 / track.sample_time))
    count = (stop - first) // size
    if count < FEWEST_SECONDS:
        return 0.0
    means = track.residual[first : first + count * size].reshape(count, size).mean(axis=1)
    times = np.arange(count) - (count - 1) / 2
    slope = float(times @ means / (times @ times))
    left = means - means.mean() - slope * times
    deviation = float(np.sqrt(left @ left / (count - 2) / (times @ times)))
    significant = ndtr(-abs(slope) / max(deviation, TINY)) < CHANCE / 2
    return slope / (size * track.sample_time) if significant else 0.0


def _period(tracks: Sequence[Track]) -> float | None:
    """Return the lag of the highest peak of the longest residual's autocorrelation, if that is clearly a peak."""
    track = max(tracks, key=lambda t: t.residual.size)
    n = track.residual.size
    centred = track.residual - track.residual.mean()
    correlation = np.fft.irfft(np.abs(np.fft.rfft(centred, 2 * n)) ** 2)[: n // 2]
    if not correlation[0] > 0:
        return None
    # This removes the taper that is due to the shorter overlap.
    correlation = correlation / correlation[0] * n / (n - np.arange(n // 2))
    below = np.flatnonzero(correlation < 0)
    if below.size == 0:
        return None
    later = correlation[below[0] :]
    # Multiples of the period have peaks of the same height but for noise, so the first one counts.
    high = np.flatnonzero(later > max(MOST, NEARLY_ALL * later.max()))
    if high.size == 0:
        return None
    first = high[: int(np.argmax(np.diff(high, append=high[-1] + 2) > 1)) + 1]
    return int(below[0] + first[np.argmax(later[first])]) * track.sample_time


def _few_change_points(features: np.ndarray) -> list[int]:
    penalty = 2 * features.shape[0] * np.log(features.shape[1])
    edges = _change_points(features, penalty)
    while len(edges) > MOST_PIECES + 1:
        penalty *= 2
        edges = _change_points(features, penalty)
    return edges


def _change_points(features: np.ndarray, penalty: float) -> list[int]:
    """Divide rows of features optimally into pieces of constant mean."""
    # Differences of neighbours show the scatter without the levels. Where most are 0, as in the half of a record in which
    # a reading is missing, they show none, and the levels themselves must do.
    scatter = np.median(np.abs(np.diff(features, axis=1)), axis=1) / (0.6745 * np.sqrt(2))
    scatter = np.where(scatter > 0.0, scatter, features.std(axis=1))
    standard = features / np.where(scatter > 0.0, scatter, 1.0)[:, None]
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
