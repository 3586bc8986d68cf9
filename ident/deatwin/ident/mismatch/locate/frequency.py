"""At which frequencies the mismatch is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch
from scipy.stats import chi2

from deatwin.ident.mismatch.locate.discoveries import discoveries
from deatwin.ident.mismatch.locate.track import Track

__all__ = ["Band", "locate_frequency"]

SEGMENT_SECONDS = 20.0
LOUD = 2.0
"""A line of the spectrum counts when it has this many times the power of the sensor's noise."""


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
    lines = np.flatnonzero(discoveries(chi2.sf(ratio * degrees, degrees)) & (ratio > LOUD))
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


def _runs(lines: np.ndarray) -> list[np.ndarray]:
    """Consecutive integers, in groups; a gap of one line does not part a group."""
    return [run for run in np.split(lines, np.flatnonzero(np.diff(lines) > 2) + 1) if run.size]
