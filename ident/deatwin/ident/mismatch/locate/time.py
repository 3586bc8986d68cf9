"""When the mismatch is."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch.locate.track import Track

__all__ = ["Window", "locate_time"]

WINDOW_SECONDS = 2.0
MOST_PIECES = 5


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
