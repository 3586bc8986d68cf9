"""Detect sensor faults from single readings (isolated values, resolution, limits); used for all input data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import Array

FEWEST_LEVELS = 50  # Fewest values of a continuous signal; one with fewer moves in steps, and its holds are intended
SHORTEST_ROW = 3
RISE_SAMPLES = 10
"""Most samples in the rise time of a plant that is sampled slowly because it is slow (Åström & Wittenmark,
Computer-Controlled Systems, 3rd ed., section 2.9)."""
PILED_UP = 3  # A limit holds more than this many times the readings of any of its five neighbouring levels


def samples_in(seconds: float, sample_time: float) -> int:
    """Return the samples in a number of seconds, or in the rise time of a plant that is sampled slowly."""
    return max(RISE_SAMPLES, round(seconds / sample_time))


def neighbours_deviation(signal: Array) -> Array:
    """Return the distance (n,) of each value from the cubic through its four neighbours."""
    deviation = np.zeros(signal.size)
    near, far = signal[1:-3] + signal[3:-1], signal[:-4] + signal[4:]
    deviation[2:-2] = signal[2:-2] - (4.0 * near - far) / 6.0
    return deviation


def resolution(signal: Array) -> float:
    """Return the step of which all differences are multiples. Shapes: `signal` (n,)."""
    steps = np.diff(np.unique(signal))
    steps = steps[steps > 1e-9 * np.ptp(signal)]
    if steps.size < 2 or steps.size > signal.size / 2:
        return 0.0
    counts = steps / steps.min()
    on_grid = np.all(np.abs(counts - np.round(counts)) < 0.02 * counts)
    return float(steps.min()) if on_grid else 0.0


def noise_of_bends(signal: Array) -> float:
    """Return the deviation of white noise with second differences as large as those of a signal (n,)."""
    bend = np.diff(signal, n=2)
    return 1.4826 * float(np.median(np.abs(bend - np.median(bend)))) / np.sqrt(6.0)


def at_limit(signal: Array) -> dict[str, list[NDArray[np.intp]]]:
    """Return three or more successive readings at the largest or the smallest value. Shapes: `signal` (n,)."""
    levels, counts = np.unique(signal, return_counts=True)
    if levels.size < FEWEST_LEVELS:
        return {}
    found = {}
    for word, edge, inside in (("smallest", 0, slice(1, 6)), ("largest", -1, slice(-6, -1))):
        rows = [run for run in runs(signal == levels[edge]) if run.size >= SHORTEST_ROW]
        if rows and counts[edge] > PILED_UP * counts[inside].max():
            found[word] = rows
    return found


def runs(flags: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the positions of each run of True. Shapes: `flags` (n,)."""
    where = np.flatnonzero(flags)
    return [run for run in np.split(where, np.flatnonzero(np.diff(where) > 1) + 1) if run.size]
