"""Find repeated stretches of command; differences between their readings cannot come from the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from deatwin.ident.mismatch.result import Repeatability
from deatwin.ident.mismatch.thresholds import (
    ACCURACY,
    DEVIATIONS,
    MOST_WINDOWS,
    MOVES,
    PRACTICAL_SHARE,
    SETTLING_SECONDS,
    STRETCHES,
    WINDOW_SECONDS,
)
from deatwin.ident.soundness import samples_in

SUMS = 4.0
"""Largest difference between sums of equal commands with standard normal weights, in standard deviations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Repeats:
    """Pairs of samples at the same place of the same command."""

    first: np.ndarray  # (m,), positions in all recordings, one after another
    second: np.ndarray  # (m,), positions of the repeats, likewise
    run: np.ndarray  # (m,), number of the stretch to which a pair belongs


def find_repeats(commands: Sequence[np.ndarray], sample_time: float) -> Repeats | None:
    """Find repeated stretches of commands, (n_r,) each, in and across recordings; None if they last less than 4 s."""
    # A repeat has at least two seconds of equal commands. Each stretch is paired with its next return, and its first
    # second is left out, since the plant still shows what came before.
    settling = samples_in(SETTLING_SECONDS, sample_time)
    width = max(2 * settling, round(WINDOW_SECONDS / sample_time))
    values = np.concatenate(commands)
    offsets = np.cumsum([0, *(c.size for c in commands)])
    inside = [np.arange(a, b - width + 1) for a, b in pairwise(offsets)]
    starts = np.concatenate(inside)
    span = float(np.ptp(values))
    if starts.size < 2 or span == 0.0:
        return None
    long_enough = [c for c in commands if c.size >= width]
    moving = np.concatenate([_ranges(c, width) for c in long_enough]) > MOVES * span
    starts = starts[moving]
    if starts.size < 2:
        return None
    marks = np.concatenate([_marks((c - values.min()) / span, width) for c in long_enough])[moving]
    again = _next_returns(marks, SUMS * ACCURACY * np.sqrt(width))
    return _pairs(starts[again >= 0], starts[again[again >= 0]], width, settling, sample_time)


def _ranges(values: np.ndarray, width: int) -> np.ndarray:
    """Return the range of the values in each window, shape (n - width + 1,)."""
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    return np.asarray(windows.max(axis=1) - windows.min(axis=1))


def _marks(values: np.ndarray, width: int) -> np.ndarray:
    """Return two sums of each window with random weights, shape (n - width + 1, 2)."""
    # Equal windows have equal sums for any weights; other windows hardly ever do. The windows would take gigabytes.
    from scipy.signal import oaconvolve

    weights = np.random.default_rng(0).standard_normal((width, 2))
    return np.stack([oaconvolve(values, column[::-1], mode="valid") for column in weights.T], axis=1)


def _next_returns(marks: np.ndarray, tolerance: float) -> np.ndarray:
    """Return, for each window, the number of the next window with equal values; -1 if there is none."""
    count = len(marks)
    order = np.argsort(marks[:, 0], kind="stable")
    again = np.full(count, count)
    for apart in range(1, min(count, MOST_WINDOWS)):
        here, there = order[:-apart], order[apart:]
        near = marks[there, 0] - marks[here, 0] < tolerance
        if not near.any():
            break
        same = near & (np.abs(marks[here, 1] - marks[there, 1]) < tolerance)
        np.minimum.at(again, np.minimum(here[same], there[same]), np.maximum(here[same], there[same]))
    return np.where(again < count, again, -1)


def _pairs(first: np.ndarray, second: np.ndarray, width: int, settling: int, sample_time: float) -> Repeats | None:
    """Join consecutive windows with the same lag to stretches, and pair their samples."""
    if first.size == 0:
        return None
    cuts = np.flatnonzero((np.diff(first) != 1) | (np.diff(second) != 1)) + 1
    here, there, run = [], [], []
    for number, (a, b) in enumerate(zip(np.split(first, cuts), np.split(second, cuts), strict=True)):
        steps = np.arange(settling, a.size + width - 1)
        here.append(a[0] + steps)
        there.append(b[0] + steps)
        run.append(np.full(steps.size, number))
    found = Repeats(first=np.concatenate(here), second=np.concatenate(there), run=np.concatenate(run))
    # Stretches with different returns may overlap, by at most a window; each sample is kept only once.
    kept = np.unique(found.first, return_index=True)[1]
    if kept.size < max(2 * STRETCHES, 2 * WINDOW_SECONDS / sample_time):
        return None
    return Repeats(first=found.first[kept], second=found.second[kept], run=found.run[kept])


def repeatability(residual: np.ndarray, repeats: Repeats, noise: float) -> Repeatability:
    """Compare a residual, (n,), with itself where the command repeats; `noise` is in the residual's unit."""
    # The bounds come from a jackknife over twenty blocks of pairs.
    one, other = (_less_means(residual[k], repeats.run) for k in (repeats.first, repeats.second))
    blocks = np.minimum(np.arange(one.size) * STRETCHES // one.size, STRETCHES - 1)
    products = np.bincount(blocks, weights=one * other)
    squares = np.bincount(blocks, weights=(one**2 + other**2) / 2)
    counts = np.bincount(blocks)
    cross, square = products.sum() / one.size, squares.sum() / one.size
    out = one.size - counts
    left = _share((products.sum() - products) / out, (squares.sum() - squares) / out, noise)
    share = float(_share(cross, square, noise))
    deviation = float(np.sqrt((counts.size - 1) * np.mean((left - left.mean()) ** 2)))
    within = float(np.mean((residual[repeats.first] - residual[repeats.second]) ** 2) / 2)
    total = float(np.var(np.concatenate([residual[repeats.first], residual[repeats.second]])))
    return Repeatability(
        correlation=float(cross / square) if square > 0 else 0.0,
        share=share,
        low=share - DEVIATIONS * deviation,
        high=share + DEVIATIONS * deviation,
        explainable=max(0.0, 1 - within / total) if total > 0 else 0.0,
    )


def _share(cross: np.ndarray | float, square: np.ndarray | float, noise: float) -> np.ndarray:
    """Return covariance over variance beyond noise, of which at least a tenth of the noise's variance is assumed."""
    return np.asarray(cross / np.maximum(np.asarray(square) - noise**2, PRACTICAL_SHARE * noise**2))


def _less_means(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Subtract the mean of each run."""
    _, index = np.unique(run, return_inverse=True)
    return values - (np.bincount(index, weights=values) / np.bincount(index))[index]
