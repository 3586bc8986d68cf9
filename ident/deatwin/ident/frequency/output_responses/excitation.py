"""A test signal for nonlinear output frequency responses: a flat, band-limited pulse."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import real_number, real_numbers
from deatwin.ident.frequency.output_responses.powers import (
    InputSpectrum,
    checked_band,
    checked_sample_time,
    input_spectrum,
)
from deatwin.ident.narx.document import OperatingRange
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new, written_unit
from deatwin.plant.errors import ModelError

_LINES = 20  # lines up to the end of the band if no period is given
_MOST_SAMPLES = 10_000_000  # most samples of a period, 80 MB
_EDGE = 1e-9  # relative distance from an end of the band within which a line is in the band


@dataclass(frozen=True, kw_only=True, eq=False)
class TestSignal(Described):
    """One period of a test signal. Functions that take an excitation accept this object like an array.

    Parameters
    ----------
    values : ndarray, shape (n_samples,)
        Deviations from the operating input, in ``unit``. `design_excitation` returns a pulse with its peak at the first
        sample.
    sample_time : float
        Sampling time, s.
    band_Hz : tuple of two floats
        Lowest and highest excited frequency, Hz.
    unit : str
        Unit of the values.
    """

    values: Array = field(
        metadata=variable("time", name="value", unit=attrgetter("unit"), about="deviation from the operating input")
    )
    sample_time: float = field(metadata=attribute())
    band_Hz: tuple[float, float] = field(metadata=attribute(of=lambda signal: list(signal.band_Hz)))
    unit: str

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "time": coordinate("time", of=lambda signal: signal.sample_time * np.arange(signal.values.size), unit="s"),
        "crest_factor": attribute(),
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", real_numbers(self.values, "values"))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if dtype is None and not copy:
            return self.values
        return np.array(self.values, dtype=dtype)

    def __len__(self) -> int:
        return self.values.size

    @property
    def amplitude(self) -> float:
        """Largest magnitude of the values, in ``unit``."""
        return float(np.abs(self.values).max())

    @property
    def period(self) -> float:
        """Length of the period, s."""
        return self.values.size * self.sample_time

    @property
    def crest_factor(self) -> float:
        """Amplitude divided by root mean square."""
        return self.amplitude / float(np.sqrt(np.mean(self.values**2)))

    def scaled(self, factor: float) -> TestSignal:
        """Return the signal multiplied by `factor`; ModelError if a value overflows."""
        share = real_number(factor, "the factor")
        if not math.isfinite(share * self.amplitude):
            raise ModelError(f"the factor is {factor}; it must leave the values finite")
        return replace(self, values=share * self.values)

    def input_spectrum(self, order: int) -> InputSpectrum:
        """Return the spectrum of the signal to the power `order`, which is at least 1."""
        return input_spectrum(self.values, order, self.sample_time, unit=self.unit)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot one period, with the pulse in the middle, on `ax` or new axes."""
        axes = axes_or_new(ax)
        half = self.values.size // 2
        timepts = (np.arange(self.values.size) - half) * self.sample_time
        axes.plot(timepts, np.roll(self.values, half))
        axes.set(xlabel="time (s)", ylabel=f"input ({written_unit(self.unit)})" if self.unit else "input")
        return axes


@taking(unit=instance(str))
def design_excitation(
    band_Hz: ArrayLike,
    sample_time: float,
    *,
    amplitude: float | None = None,
    operating: OperatingRange | None = None,
    period: float | None = None,
    unit: str = "",
) -> TestSignal:
    """Design a periodic pulse that contains all spectral lines of a band with equal amplitude and phase.

    The pulse is proportional to (sin(2 pi b t) - sin(2 pi a t)) / t for a band from a to b. All contributions to the
    spectrum of its n-th power are in phase, so none cancel. A nonlinear output frequency response (NOFRF) is then a
    mean of the generalised frequency response with positive weights. The disadvantage is a high crest factor.

    Parameters
    ----------
    band_Hz : array_like, shape (2,)
        Lowest and highest frequency, Hz; the highest must be below half the sampling rate.
    sample_time : float
        Sampling time, s.
    amplitude : float, optional
        Largest deviation from the operating input, in the input's unit.
    operating : OperatingRange, optional
        Operating range of a model's training data, to be given instead of the amplitude. The amplitude is then the
        distance from the range's centre to its nearer limit.
    period : float, optional
        Length of the period, s; rounded to whole samples. By default 20 periods of the highest frequency.
    unit : str
        Unit of the input.

    Raises
    ------
    ModelError
        If an argument is invalid, if the band contains no spectral line of the period, if the period has fewer than two
        or more than 10 million samples, or if not exactly one of `amplitude` and `operating` is given.

    References
    ----------
    W. R. Jacobs, "Identification and Frequency Response Analysis with Application to Soft Smart Actuators", thesis,
    University of Sheffield, eq. 4.69.
    """
    low, high = checked_band(band_Hz, "Hz")
    rate = 1.0 / checked_sample_time(sample_time)
    if not 0 < high < rate / 2:
        raise ModelError(
            f"the band is {band_Hz!r}; it must be two frequencies (low, high) in Hz with the high one above 0 and "
            f"below half the sampling rate, {rate / 2:g} Hz"
        )
    size = _amplitude(amplitude, operating)
    n = _samples(_LINES / high if period is None else period, rate)
    lines = np.fft.rfftfreq(n, sample_time)
    excited = (lines >= low * (1 - _EDGE)) & (lines <= high * (1 + _EDGE))
    if not excited[1:].any():
        raise ModelError(
            f"no line of a period of {n * sample_time:g} s lies in the band of {low:g} to {high:g} Hz; lines lie "
            f"{1 / (n * sample_time):g} Hz apart: choose a longer period"
        )
    pulse = np.fft.irfft(excited.astype(np.float64), n)
    inside = lines[excited]
    return TestSignal(
        values=size * (pulse / pulse[0]),
        sample_time=float(sample_time),
        band_Hz=(float(inside[0]), float(inside[-1])),
        unit=unit,
    )


def _amplitude(amplitude: float | None, operating: OperatingRange | None) -> float:
    if (amplitude is None) == (operating is None):
        raise ModelError("give either the amplitude or the operating range of a model, and not both")
    if operating is not None:
        if operating.input_centre.size != 1:
            raise ModelError(f"the operating range is of {operating.input_centre.size} inputs; it must be of one")
        centre = operating.input_centre[0]
        amplitude = min(centre - operating.input_min[0], operating.input_max[0] - centre)
    size = real_number(amplitude, "the amplitude")
    if not 0 < size < math.inf:
        raise ModelError(
            f"the amplitude is {size:g}; it must be positive (and the operating input inside of the training data)"
        )
    return size


def _samples(period: float, rate: float) -> int:
    length = real_number(period, "the period") * rate
    if not 1.5 <= length <= _MOST_SAMPLES:
        raise ModelError(
            f"the period is {period:g} s; it must hold at least two samples, {2 / rate:g} s, and at most "
            f"{_MOST_SAMPLES}, {_MOST_SAMPLES / rate:g} s"
        )
    return round(length)
