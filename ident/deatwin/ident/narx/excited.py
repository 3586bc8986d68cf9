"""The bands that a recording excited."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording, label

BAND_KEY, HOLES_KEY = "excited_band_Hz", "excited_holes_Hz"
"""Keys of a model's provenance: the highest frequency that its recording excited and any holes below it, Hz."""
_FEWEST = 64
_EXCITED_SHARE = 0.99  # share of the input's power below the highest excited frequency
# Smallest power of an exciting line, relative to the mean of all lines. The error of a gain is inverse to the root of the
# power (Bendat and Piersol, Random Data, chapter 9): with a thousandth, 30 times that of an even input. A step has a
# hundredth of the mean at the end of its band.
_FAINT = 1e-3
# A line covers a sixth of an octave to either side, because a lightly damped mode could hide in a wider gap, and at least
# a tenth of the band, so that odd harmonics leave no gaps. A band that starts in the lowest tenth extends to 0 Hz.
_REACH_RATIO, _REACH_SHARE = 2.0 ** (1 / 6), 0.1
_LOBE = 2  # Lines from 0 Hz on over which the window smears the remainder of a removed trend; alone they are no band

Band = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Frequency bands that the input of a recording excited.

    Parameters
    ----------
    bands : tuple of (float, float)
        Lowest and highest frequency of each band, Hz, in ascending order and without overlap; at least one band.

    Raises
    ------
    ModelError
        If there is no band, or the bands overlap or are not in ascending order.
    """

    bands: tuple[Band, ...]

    def __post_init__(self) -> None:
        edges = [edge for low, high in self.bands for edge in (low, high)]
        if not edges or not (0.0 <= edges[0] and edges[-1] < inf and all(low < high for low, high in pairwise(edges))):
            raise ModelError("the bands of an excitation must be one or more, rising and apart, from 0 Hz on")

    @property
    def highest_Hz(self) -> float:
        """Highest excited frequency, Hz: the upper end of the last band."""
        return self.bands[-1][1]

    @property
    def holes(self) -> tuple[Band, ...]:
        """Gaps below the first band and between bands, Hz."""
        ends = (0.0, *(high for _, high in self.bands))
        return tuple((end, low) for end, (low, _) in zip(ends, self.bands, strict=False) if low > end)

    def hole_at(self, frequency_Hz: float) -> Band | None:
        """Return the gap, Hz, in which `frequency_Hz` lies; None if it lies in a band or above all bands."""
        return next(((low, high) for low, high in self.holes if low < frequency_Hz < high), None)

    @property
    def provenance(self) -> dict[str, str]:
        """Entries for the provenance of a `NarxModel`; gaps are written only if there are any."""
        band = {BAND_KEY: f"{self.highest_Hz:.6g}"}
        holes = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in self.holes)
        return {**band, HOLES_KEY: holes} if holes else band

    @classmethod
    def of_provenance(cls, provenance: Mapping[str, str]) -> Self | None:
        """Read the excitation from a model's `provenance`; None if absent, ModelError if it is invalid."""
        if (band := number_of(provenance, BAND_KEY)) is None:
            return None
        if band <= 0.0:
            raise ModelError(f"the model's provenance has {BAND_KEY} = {band:g}: it must be a positive number")
        holes = provenance.get(HOLES_KEY, "")
        try:
            edges = [float(edge) for hole in holes.split(", ") for edge in hole.split(" to ")] if holes else []
        except ValueError:
            edges = [inf]
        ends = (*edges, band)
        if len(edges) % 2 or not all(0.0 <= low < high for low, high in pairwise(ends)):
            raise ModelError(
                f"the model's provenance has {HOLES_KEY} = {holes!r}: it must be rising frequencies below {band:g}, "
                "such as '0.25 to 0.95'"
            )
        outer = (edges if edges and edges[0] == 0.0 else [0.0, 0.0, *edges])[1:]
        return cls(bands=tuple(zip(outer[::2], (*outer[1::2], band), strict=True)))

    @classmethod
    def joined(cls, several: Iterable[Self]) -> Self:
        """Return the union of the bands of `several` excitations, at least one."""
        return cls(bands=tuple(union_of(band for one in several for band in one.bands)))


def union_of(bands: Iterable[Band], near: float = 0.0) -> list[Band]:
    """Join bands that overlap, touch, or lie within `near` of each other."""
    joined: list[Band] = []
    for low, high in sorted(bands):
        if joined and low <= joined[-1][1] + near:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return joined


def excited_band(recording: Recording) -> float:
    """Return the frequency below which the input of a recording has 99 % of its power.

    Parameters
    ----------
    recording : Recording
        Recording whose first input is analysed. Its mean and its linear trend are removed first.

    Returns
    -------
    float
        Frequency, Hz.

    Raises
    ------
    DataError
        If the input is constant, a ramp, or shorter than 64 samples.
    """
    return _last_line(_power(recording)) / recording.duration


def excitation(recording: Recording) -> Excitation:
    """Find the frequency bands in which the input of a recording has power.

    The highest frequency is that of `excited_band`. A spectral line below this frequency counts as excited if its power
    is at least a thousandth of the mean power of these lines. On either side, an excited line covers a sixth of an
    octave, or a tenth of the highest frequency if this is wider. Lines whose ranges overlap form one band.

    Parameters
    ----------
    recording : Recording
        Recording whose first input is analysed. Its mean and its linear trend are removed first.

    Raises
    ------
    DataError
        If the input is constant, a ramp, or shorter than 64 samples.

    References
    ----------
    J. S. Bendat, A. G. Piersol, Random Data: Analysis and Measurement Procedures, 4th edition, Wiley 2010, chapter 9:
    the error of a frequency response by coherence and number of averages.
    """
    power = _power(recording)
    last = _last_line(power)
    heard = np.flatnonzero(power[: last + 1] >= _FAINT * power[: last + 1].mean())
    lows = np.minimum(heard / _REACH_RATIO, heard - _REACH_SHARE * last)
    highs = np.minimum(np.maximum(heard * _REACH_RATIO, heard + _REACH_SHARE * last), last)
    first = np.append(True, lows[1:] > highs[:-1])  # True for the first line of a band
    if first.sum() > 1 and heard[np.append(first[1:], True)][0] <= _LOBE:
        keep = np.cumsum(first) > 1
        lows, highs, first = lows[keep], highs[keep], first[keep]
    starts, ends = lows[first], highs[np.append(first[1:], True)]
    starts[0] = starts[0] if starts[0] > _REACH_SHARE * last else 0.0
    bands = np.column_stack([starts, ends]) / recording.duration
    return Excitation(bands=tuple((float(low), float(high)) for low, high in bands))


def _power(recording: Recording) -> NDArray[np.float64]:
    """Return the power at each spectral line of the input, from 0 Hz; lines are 1 / duration apart."""
    if not isinstance(recording, Recording):
        raise DataError(f"one recording is needed, not a {type(recording).__name__}")
    command = recording.inputs[0]
    if not np.ptp(command) > 0.0:
        raise DataError(f"{label(recording)}: the input is constant: it excites nothing")
    if command.size < _FEWEST:
        raise DataError(
            f"{label(recording)}: {command.size} samples do not determine the spectrum of the input; {_FEWEST} would"
        )
    # A trend, or ends that do not meet, would look like power at all frequencies.
    timepts = np.linspace(-1.0, 1.0, command.size)
    trend = np.polynomial.Polynomial.fit(timepts, command, 1)(timepts)
    left = command - trend
    if not np.abs(left).max() > 1e-9 * np.ptp(command):
        raise DataError(f"{label(recording)}: the input is a ramp: it excites nothing but the slowest motion")
    return np.asarray(np.abs(np.fft.rfft(left * np.hanning(command.size))) ** 2)


def _last_line(power: NDArray[np.float64]) -> int:
    return int(np.searchsorted(np.cumsum(power), _EXCITED_SHARE * power.sum()))


def number_of(provenance: Mapping[str, str], key: str) -> float | None:
    """Read a number from a model's provenance; None if it is absent."""
    if (written := provenance.get(key)) is None:
        return None
    try:
        value = float(written)
    except ValueError:
        value = inf
    if not isfinite(value):
        raise ModelError(f"the model's provenance has {key} = {written!r}: it must be a number")
    return value
