"""In which operating region the mismatch is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from deatwin.ident.mismatch.locate.discoveries import discoveries
from deatwin.ident.mismatch.locate.track import Track

__all__ = ["Region", "locate_region"]

BINS = 12


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
    passed = discoveries(np.array([row[-1] for row in found]))
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
