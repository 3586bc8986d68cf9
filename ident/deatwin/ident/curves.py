"""Describe shape, loops and spectra of a recording by numbers: `u` (n,) are its commands, V, and `y` (n,) readings, m."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.plant.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A straight line through the lower part of a voltage-displacement curve."""

    gain: float  # Slope, m/V
    offset: float  # Displacement at 0 V, m
    misfit: float  # Largest distance of the lower part from the line, divided by the stroke of the whole curve


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearShare:
    """Spectra of an output and of the part that the best linear model explains."""

    frequencies: Array  # shape (n,): Middle of each band, Hz
    inputs: Array  # shape (n,): Spectral density of the input, unit² / Hz
    outputs: Array
    explained: Array
    width: float  # Width of a band, Hz

    def above(self, frequency: float) -> tuple[float, float, float]:
        """Powers of input, output and explained output above a frequency, Hz."""
        there = self.frequencies > frequency
        return tuple(float(p[there].sum() * self.width) for p in (self.inputs, self.outputs, self.explained))  # type: ignore[return-value]


def mean_curve(u: Array, y: Array, width: float = 0.05, least: int = 20) -> tuple[Array, Array]:
    """Return mean command, V, and mean reading, m, (m,) each, in bins of `width` V with at least `least` samples."""
    number = np.floor((u - u.min()) / width + 1e-9).astype(int)
    count = np.bincount(number)
    used = count >= least
    return tuple(np.bincount(number, v)[used] / count[used] for v in (u, y))  # type: ignore[return-value]


def straight_line(u: Array, y: Array, below: float = 2.5) -> Line:
    """Fit a straight line to the lower part of a voltage-displacement curve, V and m, up to `below`, V."""
    lower = u <= below
    if lower.sum() < 3:
        raise DataError(f"{int(lower.sum())} points up to {below:g} V: a line needs at least three to be judged")
    gain, offset = np.polyfit(u[lower], y[lower], 1)
    misfit = np.abs(y[lower] - (offset + gain * u[lower])).max() / np.ptp(y)
    return Line(gain=float(gain), offset=float(offset), misfit=float(misfit))


def local_gain(u: Array, y: Array, at: float, width: float = 0.2) -> float:
    """Slope of the voltage-displacement curve at a command, m/V, by a parabola through samples within `width`, V."""
    near = np.abs(u - at) <= width
    if near.sum() < 4:
        raise DataError(f"{int(near.sum())} samples within {width:g} V of {at:g} V: a slope needs at least four")
    return float(np.polyfit(u[near] - at, y[near], 2)[1])


def loop_area(u: Array, y: Array) -> float:
    r"""Area :math:`\oint u\,dy` of a closed loop, divided by the area of the rectangle around it."""
    # A cycle begins where the command leaves its lowest value.
    lowest = np.isclose(u, u.min())
    cycles = max(1, int(np.sum(lowest & ~np.roll(lowest, 1))))
    area = 0.5 * np.sum(u * np.roll(y, -1) - np.roll(u, -1) * y)
    return float(area / (cycles * np.ptp(u) * np.ptp(y)))


def linear_share(u: Array, y: Array, sample_time: float, width: float = 0.025) -> LinearShare:
    """Return spectra of output and best linear approximation in bands of `width` Hz (Pintelon & Schoukens 2012)."""
    n = u.size
    if width * n * sample_time < 2:
        raise DataError(f"{n * sample_time:g} s: bands of {width:g} Hz need at least {2 / width:g} s")
    lines = np.arange(1, (n - 1) // 2 + 1)
    spectra = [np.fft.rfft(v - v.mean())[lines] for v in (u, y)]
    band = np.ceil(lines / (n * sample_time) / width - 1e-9).astype(int) - 1
    scale = 2 * sample_time / n / np.bincount(band)
    uu, yy = (scale * np.bincount(band, np.abs(s) ** 2) for s in spectra)
    cross = spectra[1] * spectra[0].conj()
    yu = scale * (np.bincount(band, cross.real) + 1j * np.bincount(band, cross.imag))
    return LinearShare(
        frequencies=(np.arange(uu.size) + 0.5) * width,
        inputs=uu,
        outputs=yy,
        explained=np.abs(yu) ** 2 / uu,
        width=width,
    )
