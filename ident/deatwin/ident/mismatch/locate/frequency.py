"""Location of the mismatch in frequency: in bands and, under a periodic input, by groups of spectral lines.

A periodic input excites some lines of the spectrum. A residual on these comes from wrong linear dynamics or a wrong
gain; a residual on even lines that were not excited comes from an even nonlinearity, and on odd ones from an odd one.
The part that differs from period to period comes from noise or from something that drifts.

References
----------
Schoukens, Vaes, Pintelon, "Linear system identification in a nonlinear setting: nonparametric analysis of the nonlinear
distortions and their impact on the best linear approximation", IEEE Control Syst. 36 (2016) 38-69.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc, fdtrc

from deatwin.ident.mismatch.locate.track import FEWEST, SI, Track, Unit
from deatwin.ident.mismatch.located import Band, LineGroup
from deatwin.ident.mismatch.thresholds import ACCURACY, CHANCE, NEGLIGIBLE, SEGMENT_SAMPLES, TINY
from deatwin.plant.amplitudes import axis_label, written_unit
from deatwin.plant.arrays import Array
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
    from scipy.stats import false_discovery_control

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
    # Readings without any noise may leave a line without a p-value: it shows nothing.
    p_values = np.nan_to_num(chdtrc(degrees, ratio * degrees), nan=1.0)
    lines = np.flatnonzero((false_discovery_control(p_values) <= CHANCE) & (ratio > LOUD))
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


FEWEST_PERIODS = 2
WORDS = {
    "excited": "in the input",
    "odd": "odd, not in\nthe input",
    "even": "even, not in\nthe input",
    "varying": "all, differing\nbetween periods",
}
"""Groups of lines in words."""


@dataclass(frozen=True, kw_only=True)
class Lines(Described):
    """The residual under a periodic input, by groups of lines."""

    period_s: float = field(metadata=variable(name="period", unit="s", about="period of the input"))
    periods: int = field(metadata=variable(about="periods that were compared"))
    groups: tuple[LineGroup, ...] = field(metadata=table_along("group"))  # those that have lines

    def plot(self, ax: Axes | None = None, *, unit: Unit = SI) -> Axes:
        """Draw the rms of each group; `unit` is a name and its SI size."""
        ax = axes_or_new(ax)
        name, size = unit
        bars = ax.bar([WORDS[g.kind] for g in self.groups], [g.rms / size for g in self.groups], color="C0")
        ax.bar_label(bars, [f"p = {g.p_value:.2g}" for g in self.groups], fontsize="small")
        ax.margins(y=0.15)
        ax.set_xlabel(f"harmonics of the input, which has a period of {self.period_s:.3g} s")
        ax.set_ylabel(axis_label("residual, rms", written_unit(name)))
        return ax


def locate_lines(tracks: Sequence[Track], noise: float) -> Lines | None:
    """Sort the residual under the longest periodic command by lines; None if no record holds two periods."""
    # The first signal of each track is the command.
    for track in sorted(tracks, key=lambda t: -t.residual.size):
        command = next(iter(track.signals.values()), np.empty(0))
        period = _period(command)
        if period is not None:
            return _grouped(track, command, period, noise)
    return None


def _period(command: Array) -> int | None:
    """Return after how many samples a command repeats, counted back from its end, at least `FEWEST_PERIODS` times."""
    n, span = command.size, float(np.ptp(command)) if command.size else 0.0
    if not span > 0:
        return None
    last = command[::-1] - command.mean()
    longest = n // FEWEST_PERIODS
    # Squared distance of the command's end from the same command shifted: zero if it repeats.
    head = last[: n - longest]
    if np.ptp(head) <= ACCURACY * span:  # it rests, as after a step
        return None
    squares = np.concatenate([[0.0], np.cumsum(last**2)])
    size = 1 << (2 * n).bit_length()
    cross = np.fft.irfft(np.fft.rfft(last, size) * np.conj(np.fft.rfft(head, size)), size)[: longest + 1]
    shifts = np.arange(longest + 1)
    apart = squares[head.size] + squares[shifts + head.size] - squares[shifts] - 2 * cross
    alike = np.flatnonzero(apart[1:] <= (10 * ACCURACY * span) ** 2 * head.size) + 1
    for shift in alike[alike > 2]:  # shorter periods have no line between 0 and the Nyquist frequency
        if np.abs(last[shift : shift + head.size] - head).max() <= ACCURACY * span:
            return int(shift)
    return None


def _grouped(track: Track, command: Array, period: int, noise: float) -> Lines:
    # The first period is left out if enough others remain, because the plant may not have settled in it.
    kept = max(_repeats(command, period) - 1, FEWEST_PERIODS)
    spectra = np.fft.rfft(track.residual[-kept * period :].reshape(kept, period), axis=1)[:, 1 : (period + 1) // 2]
    drive = np.abs(np.fft.rfft(command[-period:]))[1 : (period + 1) // 2]
    mean = spectra.mean(axis=0)
    varying = (np.abs(spectra - mean) ** 2).sum(axis=0) / (kept - 1)
    numbers = np.arange(1, mean.size + 1)
    excited = drive > NEGLIGIBLE * drive.max()
    kinds = {"excited": excited, "odd": ~excited & (numbers % 2 == 1), "even": ~excited & (numbers % 2 == 0)}
    groups = [
        _group(kind, np.abs(mean[mask]) ** 2, varying[mask], kept, period) for kind, mask in kinds.items() if mask.any()
    ]
    degrees = 2 * mean.size * (kept - 1)
    excess = float(varying.sum()) * 2 * (kept - 1) / (noise**2 * period)
    rms = float(np.sqrt(2 * varying.sum())) / period
    groups.append(LineGroup(kind="varying", rms=rms, p_value=float(chdtrc(degrees, excess)), lines=mean.size))
    return Lines(period_s=period * track.sample_time, periods=kept, groups=tuple(groups))


def _group(kind: str, power: Array, varying: Array, periods: int, period: int) -> LineGroup:
    """Test the mean over periods against the variation between them (Fisher's F, two degrees of freedom per line)."""
    count = power.size
    ratio = float(power.sum()) * periods / max(float(varying.sum()), TINY)
    steady = max(0.0, float((power - varying / periods).sum()))
    return LineGroup(
        kind=kind,
        rms=float(np.sqrt(2 * steady)) / period,
        p_value=float(fdtrc(2 * count, 2 * count * (periods - 1), ratio)),
        lines=count,
    )


def _repeats(command: Array, period: int) -> int:
    """Return the number of complete periods at the end of a command."""
    span = float(np.ptp(command))
    same = np.abs(command[period:] - command[:-period]) <= ACCURACY * span
    broken = np.flatnonzero(~same)
    repeated = command.size - (int(broken[-1]) + 1 if broken.size else 0)
    return repeated // period
