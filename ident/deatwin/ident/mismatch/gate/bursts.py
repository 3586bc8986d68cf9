"""Bursts: stretches in which a reading is noisier than elsewhere, as beside a motor that starts or under a loose plug."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.mismatch.gate.gate import Gate
from deatwin.ident.soundness import neighbours_deviation, resolution, runs
from deatwin.plant.model import Plant

WINDOW, STRIDE = 50, 10
"""Samples over which the noise is told, and by which the window moves on."""
LONE = 5
"""Largest bends of a window that are left out: a single value far off makes so many, and is no burst."""
TWICE = 2.0
"""Factor by which a burst is noisier: a window of white noise reaches it less than once in 60 000."""
WHITE = 2.5
"""How much larger, or smaller, the variance of a burst may be than its bends say of white noise: that of a window of
white noise is so once in 1000. What is smooth, as the motion that a plant lacks, or correlated by a half, lies beyond."""
SLOW, BARTLETT = 1 / 8, 1.95
"""Frequency, in samples, below which missing physics may hide the noise, and Bartlett's limit for a cumulative periodogram
at the 0.1 % level (Priestley, Spectral Analysis and Time Series, 1981, section 6.2.6): a tone or a mode is no burst."""
MOSTLY = 0.5
"""Share of the windows with a command as brisk that are noisy: above it the noise goes with the command."""
TRIMMED = 0.66
"""Mean square of white noise of unit variance without the largest `LONE` bends of a window."""
BEND = 35.0 / 18.0
"""Variance of the distance of white noise of unit variance from the cubic through its neighbours."""


def without_bursts(checked: Gate, plant: Plant) -> Gate:
    """The recordings with the bursts of each reading marked, which stand out of what a calibrated plant leaves.

    The same object where there are none.
    """
    outputs = [plant.simulate(experiment).require().outputs for experiment in checked.experiments]
    commands = [record.inputs[0] for experiment in checked.experiments for record in experiment.recordings]
    found = {}
    for row, reading in enumerate(plant.rig.readings):
        name = reading.name if row else ""
        residuals, floor = [], reading.noise
        for experiment, simulated, sound in zip(checked.experiments, outputs, checked.sound, strict=True):
            for record, rows, mask in zip(experiment.recordings, simulated, sound, strict=True):
                measured = record.reading(name) if name else np.where(mask, record.outputs[0], np.nan)
                residuals.append(measured - rows[row])
                known = measured[np.isfinite(measured)]
                floor = max(floor, resolution(known) / float(np.sqrt(12.0)) if known.size else 0.0)
        masks = iter(noisier(residuals, commands, floor))
        marked = tuple(tuple(next(masks) for _ in experiment.recordings) for experiment in checked.experiments)
        if any(mask.any() for each in marked for mask in each):
            found[name] = marked
    return replace(checked, bursts=found) if found else checked


def noisier(residuals: Sequence[np.ndarray], commands: Sequence[np.ndarray], floor: float) -> list[np.ndarray]:
    """Samples at which residuals are much noisier than elsewhere, and white, and are not so under commands as brisk.

    `residuals` one array (n,) for each record, nan where unknown; `commands` likewise; `floor` noise below which none
    counts.
    """
    windows = [_windows(residual) for residual in residuals]
    powers = [np.sort(bends, axis=1)[:, :-LONE].mean(axis=1) for bends, _ in windows]
    usual = _usual(powers)
    if usual is None:
        return [np.zeros(residual.size, dtype=bool) for residual in residuals]
    level = _usual([bends.mean(axis=1) for bends, _ in windows])
    variance = _usual([values.var(axis=1) for _, values in windows])
    loud = [power > TWICE**2 * max(usual, TRIMMED * floor**2) for power in powers]
    briskness = [_windows(command)[0].mean(axis=1) for command in commands]
    every, noisy = np.concatenate(briskness), np.concatenate(loud)
    found = []
    for residual, (bends, values), high, brisk in zip(residuals, windows, loud, briskness, strict=True):
        mask = np.zeros(residual.size, dtype=bool)
        for run in runs(high):
            if run.size * STRIDE < WINDOW:  # a burst is in as many windows; fewer are chance, or ring after a step
                continue
            white, more = bends[run].mean() - level, values[run].var(axis=1).mean() - variance
            with_it = float(noisy[every >= np.median(brisk[run])].mean())
            stretch = slice(STRIDE * run[0], STRIDE * run[-1] + WINDOW)
            if white / WHITE < more < WHITE * white and with_it < MOSTLY and not _has_lines(residual[stretch]):
                mask[stretch] = True
        found.append(mask)
    return found


def _has_lines(values: np.ndarray) -> bool:
    """Return whether the fast part of a stretch is concentrated at some frequencies; nan if unknown."""
    known = np.nan_to_num(values - np.nanmean(values))
    # Every second line, since a Hann window makes neighbours alike.
    spectrum = np.abs(np.fft.rfft(known * np.hanning(known.size)))[int(SLOW * known.size) :: 2] ** 2
    shares = np.cumsum(spectrum) / np.sum(spectrum)
    return float(np.abs(shares - np.arange(1, shares.size + 1) / shares.size).max()) * np.sqrt(shares.size) > BARTLETT


def _usual(powers: Sequence[np.ndarray]) -> float | None:
    """The median of what is known over the windows of all records; None where nothing is."""
    known = np.concatenate(powers)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else None


def _windows(residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared bends and values of a record's windows, shape (k, n) each; the bends say the variance of white noise."""
    if residual.size < WINDOW:
        return np.empty((0, WINDOW)), np.empty((0, WINDOW))
    bends = neighbours_deviation(residual) ** 2 / BEND
    first, second = (np.lib.stride_tricks.sliding_window_view(each, WINDOW)[::STRIDE] for each in (bends, residual))
    return first, second
