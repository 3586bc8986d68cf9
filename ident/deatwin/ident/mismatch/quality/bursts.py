"""Find bursts, in which a reading is noisier than elsewhere, for instance because of a motor or a loose plug."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.mismatch.thresholds import BLOCK_SAMPLES, LOUDER, MOST, SIGNIFICANCE
from deatwin.ident.soundness import neighbours_deviation, runs

STRIDE = 10
"""Shift between successive windows in which the noise level is estimated, in samples."""
LONE = 5
"""Number of largest deviations from the cubic that are excluded from a window: a single outlier causes five, and is no
burst."""
WHITE = 2.5
"""Largest ratio, either way, between the spectral power of a burst and the power that its deviations from the cubic
imply for white noise. A window of white noise exceeds it once in 1000; a smooth residual, such as motion that the plant
lacks, and noise with a correlation of 0.5 lie beyond it."""
HIDES = 0.25
"""Share of a burst's power density; where the density of the other windows exceeds it, the burst is hidden and not
tested. The motion that a plant lacks is slow, and present in both."""
SLOW = 1 / 8
"""Frequency, in cycles per sample, below which a stretch may lack more motion than the others."""
BARTLETT = 1.63
"""Limit of Bartlett's test of the cumulative periodogram at the 1 % level (Priestley, Spectral Analysis and Time Series,
1981, section 6.2.6). Fisher's test of its largest line (6.1.4) has the same level. A residual with a tone, a mode or
correlation is no burst."""
FEWEST_LINES = 16
"""Smallest number of spectral lines that are tested: with fewer, a tone in their midst would not exceed Bartlett's
limit."""
TRIMMED = 0.66
"""Mean square, for white noise of unit variance, of the deviations in a window without the largest `LONE`."""
BEND = 35.0 / 18.0
"""Variance of the deviation of white noise of unit variance from the cubic through its neighbours."""


def noisier(residuals: Sequence[np.ndarray], commands: Sequence[np.ndarray], floor: float) -> list[np.ndarray]:
    """Mark samples whose residuals are white and much noisier than elsewhere, unless commands as brisk are the cause.

    Shapes: `residuals`, NaN where unknown, and `commands` (n,) for each record. Noise below `floor` does not count.
    """
    windows = [_windows(residual) for residual in residuals]
    powers = [np.sort(bends, axis=1)[:, :-LONE].mean(axis=1) for bends, _ in windows]
    usual = _usual(powers)
    if usual is None:
        return [np.zeros(residual.size, dtype=bool) for residual in residuals]
    level = _usual([bends.mean(axis=1) for bends, _ in windows])
    loud = [power > LOUDER**2 * max(usual, TRIMMED * floor**2) for power in powers]
    calm = [values[power <= LOUDER**2 * usual] for (_, values), power in zip(windows, powers, strict=True)]
    others = _densities(np.concatenate(calm)).mean(axis=0)
    briskness = [_windows(command)[0].mean(axis=1) for command in commands]
    every, noisy = np.concatenate(briskness), np.concatenate(loud)
    found = []
    for residual, (bends, _), power, high, brisk in zip(residuals, windows, powers, loud, briskness, strict=True):
        mask = np.zeros(residual.size, dtype=bool)
        for run in runs(high):
            if run.size * STRIDE < BLOCK_SAMPLES:
                continue  # a burst fills as many windows; fewer are chance, or ringing after a step
            white = bends[run].mean()
            if power[run].mean() < TRIMMED * white / LOUDER:  # isolated peaks or ringing, not uniform noise
                continue
            # If most windows with a command at least as brisk are noisy, the command is the cause.
            with_it = float(noisy[every >= np.median(brisk[run])].mean())
            stretch = slice(STRIDE * run[0], STRIDE * run[-1] + BLOCK_SAMPLES)
            if with_it < MOST and _is_white(residual[stretch], white, others, level + HIDES * (white - level)):
                mask[stretch] = True
        found.append(mask)
    return found


def has_lines(values: np.ndarray) -> bool:
    """Return whether the fast part of a stretch, (n,), NaN where unknown, is concentrated at some frequencies."""
    densities = _densities(np.nan_to_num(values - np.nanmean(values)))
    # Only every second line is used, since a Hann window correlates neighbouring lines.
    return _is_uneven(densities[int(SLOW * values.size) :: 2])


def _is_uneven(lines: np.ndarray) -> bool:
    """Return whether Fisher's or Bartlett's test finds more power in some spectral lines than in others."""
    shares = np.cumsum(lines) / np.sum(lines)
    if lines.max() > np.sum(lines) * (1 - (SIGNIFICANCE / lines.size) ** (1 / (lines.size - 1))):
        return True
    return float(np.abs(shares - np.arange(1, lines.size + 1) / lines.size).max()) * np.sqrt(lines.size) > BARTLETT


def _is_white(values: np.ndarray, variance: float, others: np.ndarray, hiding: float) -> bool:
    """Return whether a stretch is white noise, and larger than that of other windows where these do not hide it.

    `others`, (BLOCK_SAMPLES // 2 + 1,), are the mean power densities of the other windows; values from `hiding` on hide
    the stretch.
    """
    frequency, densities = np.fft.rfftfreq(values.size), _densities(values)
    usual = np.interp(frequency, np.fft.rfftfreq(BLOCK_SAMPLES), others)
    for lowest in (0.0, SLOW):
        # Only every second line is used, since a Hann window correlates neighbouring lines; the mean is no line.
        clear = (1 + np.flatnonzero((usual < hiding)[1:] & (frequency >= lowest)[1:]))[::2]
        if clear.size < FEWEST_LINES:
            return False
        lines, least = densities[clear], max(variance / WHITE, LOUDER**2 * usual[clear].mean())
        if not least < lines.mean() < WHITE * variance or _is_uneven(lines):
            return False
    return True


def _densities(values: np.ndarray) -> np.ndarray:
    """Return the power at each frequency along the last axis, without the mean; white noise of unit variance gives 1."""
    taper = np.hanning(values.shape[-1])
    about = values - values.mean(axis=-1, keepdims=True)
    return np.asarray(np.abs(np.fft.rfft(about * taper)) ** 2 / np.sum(taper**2))


def _usual(powers: Sequence[np.ndarray]) -> float | None:
    """Return the median of the known values over the windows of all records; None if nothing is known."""
    known = np.concatenate(powers)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else None


def _windows(residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return squared deviations from cubics, and the values, for a record's windows, (k, n) each."""
    if residual.size < BLOCK_SAMPLES:
        return np.empty((0, BLOCK_SAMPLES)), np.empty((0, BLOCK_SAMPLES))
    bends = neighbours_deviation(residual) ** 2 / BEND
    first, second = (
        np.lib.stride_tricks.sliding_window_view(each, BLOCK_SAMPLES)[::STRIDE] for each in (bends, residual)
    )
    return first, second
