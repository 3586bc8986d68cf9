"""Location of the mismatch in frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc

from deatwin.ident.mismatch.locate.discoveries import discoveries
from deatwin.ident.mismatch.locate.track import FEWEST, Track
from deatwin.ident.mismatch.located import Band
from deatwin.ident.mismatch.thresholds import SEGMENT_SAMPLES
from deatwin.plant.datasets import Described, coordinate, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new

SEGMENT_SECONDS, SEGMENTS = 20.0, 8
"""Length of a segment, s, or at least `SEGMENT_SAMPLES`; and number of segments in the shortest record that limits the
latter, since fewer show the power of a line to no better than a third."""
LOUD = 2.0
"""Ratio to the power of the sensor's noise above which a line of the spectrum counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bands(Described):
    """The bands of frequency that hold the mismatch; it iterates over them."""

    bands: tuple[Band, ...] = field(metadata=table_along("band"))  # in order of frequency
    # (n,), lines of the residual's spectrum.
    frequency: np.ndarray = field(metadata=coordinate("frequency", unit="Hz"))
    ratio: np.ndarray = field(metadata=variable("frequency", about="power over that of the sensor's noise"))  # (n,)

    def __iter__(self) -> Iterator[Band]:
        return iter(self.bands)

    def __len__(self) -> int:
        return len(self.bands)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the residual's spectrum over the noise's, the bands shaded."""
        ax = axes_or_new(ax)
        ax.plot(self.frequency[1:], 10 * np.log10(np.maximum(self.ratio[1:], 1e-3)), color="C0", linewidth=0.8)
        ax.axhline(0.0, color="0.4", linewidth=0.8, linestyle="--", label="sensor noise")
        for band in self.bands:
            low = max(band.from_Hz, float(self.frequency[1]) / 2)
            ax.axvspan(low, band.to_Hz, color="C1", alpha=0.3, linewidth=0)
        ax.set_xscale("log")
        ax.set_xlabel("frequency (Hz)")
        ax.set_ylabel("residual over sensor noise (dB)")
        ax.legend(loc="upper right")
        return ax


def locate_frequency(tracks: Sequence[Track], noise: float) -> Bands:
    """Return bands in which the residual's spectrum lies above white sensor noise; `noise` is in SI."""
    # Welch's estimate (IEEE Trans. Audio Electroacoust. 15 (1967) 70, doi:10.1109/TAU.1967.1161901) over segments of
    # twenty seconds, longer ones where samples are slow, is averaged over records. Each line is tested against the chi-
    # squared law of an averaged periodogram, with the false-discovery rate held at 5 % over all lines, and must have at
    # least twice the power of the noise; neighbouring lines are joined.
    from scipy.signal import welch

    step = tracks[0].sample_time
    shortest = min(track.residual.size for track in tracks)
    segment = min(max(round(SEGMENT_SECONDS / step), min(SEGMENT_SAMPLES, shortest // SEGMENTS), FEWEST), shortest)
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
    # Neighbouring half-overlapping Hann segments have a correlation of 1/6, so k of them count as k / (1 + 2/36).
    degrees = 2 * max(1.0, segments * 18 / 19)
    lines = np.flatnonzero(discoveries(chdtrc(degrees, ratio * degrees)) & (ratio > LOUD))
    width = frequency[1]
    bands = []
    for run in _runs(lines):
        bands.append(
            Band(
                from_Hz=float(max(0.0, frequency[run[0]] - width / 2)),
                to_Hz=float(frequency[run[-1]] + width / 2),
                excess_dB=float(10 * np.log10(np.mean(ratio[run]))),
            )
        )
    return Bands(bands=tuple(bands), frequency=frequency, ratio=ratio)


def _runs(lines: np.ndarray) -> list[np.ndarray]:
    """Group consecutive integers; a gap of one line does not split a group."""
    return [run for run in np.split(lines, np.flatnonzero(np.diff(lines) > 2) + 1) if run.size]
