"""Find bursts, in which a reading is noisier than elsewhere, for instance because of a motor or a loose plug."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.soundness import neighbours_deviation, runs

WINDOW, STRIDE = 50, 10
"""Samples over which the noise is told, and by which the window moves on."""
LONE = 5
"""Largest bends of a window that are left out: a single value far off makes so many, and is no burst."""
TWICE = 2.0
"""Factor by which a burst is noisier: a window of white noise reaches it less than once in 60 000."""
WHITE = 2.5
"""How much larger, or smaller, the power of a burst may be than its bends say of white noise: that of a window of white
noise is so once in 1000. What is smooth, as the motion that a plant lacks, or correlated by a half, lies beyond."""
HIDES = 0.25
"""Share of a burst's power density from which that of the other windows hides it: what the plant lacks is slow, and lies
in both."""
SLOW = 1 / 8
"""Frequency, in samples, below which a stretch may lack more than the others."""
BARTLETT, FISHER = 1.63, 0.01
"""Bartlett's limit for a cumulative periodogram at the 1 % level, and that level in Fisher's test of its largest line
(Priestley, Spectral Analysis and Time Series, 1981, sections 6.2.6 and 6.1.4): a tone, a mode or what is correlated is no
burst,"""
FEWEST_LINES = 16
"""and of fewer lines a tone in their midst would not exceed it."""
MOSTLY = 0.5
"""Share of the windows with a command as brisk that are noisy: above it the noise goes with the command."""
TRIMMED = 0.66
"""Mean square of white noise of unit variance without the largest `LONE` bends of a window."""
BEND = 35.0 / 18.0
"""Variance of the distance of white noise of unit variance from the cubic through its neighbours."""


def noisier(residuals: Sequence[np.ndarray], commands: Sequence[np.ndarray], floor: float) -> list[np.ndarray]:
    """Return samples of residuals that are white and much noisier than elsewhere, though not under commands as brisk.

    Shapes: `residuals`, nan where unknown, and `commands` (n,) for each record. Noise below `floor` does not count.
    """
    windows = [_windows(residual) for residual in residuals]
    powers = [np.sort(bends, axis=1)[:, :-LONE].mean(axis=1) for bends, _ in windows]
    usual = _usual(powers)
    if usual is None:
        return [np.zeros(residual.size, dtype=bool) for residual in residuals]
    level = _usual([bends.mean(axis=1) for bends, _ in windows])
    loud = [power > TWICE**2 * max(usual, TRIMMED * floor**2) for power in powers]
    calm = [values[power <= TWICE**2 * usual] for (_, values), power in zip(windows, powers, strict=True)]
    others = _densities(np.concatenate(calm)).mean(axis=0)
    briskness = [_windows(command)[0].mean(axis=1) for command in commands]
    every, noisy = np.concatenate(briskness), np.concatenate(loud)
    found = []
    for residual, (bends, _), power, high, brisk in zip(residuals, windows, powers, loud, briskness, strict=True):
        mask = np.zeros(residual.size, dtype=bool)
        for run in runs(high):
            if run.size * STRIDE < WINDOW:  # a burst is in as many windows; fewer are chance, or ring after a step
                continue
            white = bends[run].mean()
            if power[run].mean() < TRIMMED * white / TWICE:  # peaks and ringing, not alike throughout
                continue
            with_it = float(noisy[every >= np.median(brisk[run])].mean())
            stretch = slice(STRIDE * run[0], STRIDE * run[-1] + WINDOW)
            if with_it < MOSTLY and _is_white(residual[stretch], white, others, level + HIDES * (white - level)):
                mask[stretch] = True
        found.append(mask)
    return found


def has_lines(values: np.ndarray) -> bool:
    """Return whether the fast part of a stretch is concentrated at some frequencies; NaN if unknown."""
    densities = _densities(np.nan_to_num(values - np.nanmean(values)))
    # Every second line, since a Hann window makes neighbours alike.
    return _is_uneven(densities[int(SLOW * values.size) :: 2])


def _is_uneven(lines: np.ndarray) -> bool:
    """Return whether Fisher's or Bartlett's test finds more power in some spectral lines than in others."""
    shares = np.cumsum(lines) / np.sum(lines)
    if lines.max() > np.sum(lines) * (1 - (FISHER / lines.size) ** (1 / (lines.size - 1))):
        return True
    return float(np.abs(shares - np.arange(1, lines.size + 1) / lines.size).max()) * np.sqrt(lines.size) > BARTLETT


def _is_white(values: np.ndarray, variance: float, others: np.ndarray, hiding: float) -> bool:
    """Return whether a stretch is white noise that is larger than the others, at frequencies where these do not hide
    it.

    `others`, (WINDOW // 2 + 1,), are their mean power densities, of which those from `hiding` on hide it.
    """
    frequency, densities = np.fft.rfftfreq(values.size), _densities(values)
    usual = np.interp(frequency, np.fft.rfftfreq(WINDOW), others)
    for lowest in (0.0, SLOW):
        # Every second line, since a Hann window makes neighbours alike; the mean is no line.
        clear = (1 + np.flatnonzero((usual < hiding)[1:] & (frequency >= lowest)[1:]))[::2]
        if clear.size < FEWEST_LINES:
            return False
        lines, least = densities[clear], max(variance / WHITE, TWICE**2 * usual[clear].mean())
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
    if residual.size < WINDOW:
        return np.empty((0, WINDOW)), np.empty((0, WINDOW))
    bends = neighbours_deviation(residual) ** 2 / BEND
    first, second = (np.lib.stride_tricks.sliding_window_view(each, WINDOW)[::STRIDE] for each in (bends, residual))
    return first, second
