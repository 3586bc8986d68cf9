"""Spectra of the powers of an input, and the frequencies at which an order of the output can have energy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only, real_number, real_numbers
from deatwin.ident.frequency.linear import whole_order
from deatwin.ident.frequency.spectrum import excited_lines, line_frequencies, one_period, spectrum_of
from deatwin.ident.narx.excited import union_of
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array, Booleans, Complex
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new, written_unit
from deatwin.plant.errors import ModelError

_ROUNDING = 1e-9  # gap that still counts as contact, relative to half the sampling rate or to the highest sum


def output_frequencies(band: ArrayLike, order: int, *, sample_time: float | None = None) -> Array:
    """Return the frequencies at which the n-th order of the output can have energy if the input lies in a band.

    The output frequencies are sums w_1 + ... + w_n of n input frequencies, each positive or negative. If k of them are
    negative, the sums fill the interval from (n-k) low - k high to (n-k) high - k low. A negative sum stands for the
    frequency of the same magnitude. In sampled signals, sums beyond half the sampling rate are aliased.

    Parameters
    ----------
    band : array_like, shape (2,)
        Lowest and highest angular frequency of the input, rad/s.
    order : int
        Order n, at least 1.
    sample_time : float, optional
        Sampling time, s. By default the signals are continuous, without aliasing.

    Returns
    -------
    ndarray, shape (n_intervals, 2)
        Lowest and highest angular frequency of each interval, rad/s. The intervals are disjoint and increase.

    Raises
    ------
    ModelError
        If an argument is invalid, if the band extends beyond half the sampling rate, or if the sums overflow.

    References
    ----------
    Lang, Billings, "Output frequencies of nonlinear systems", Int. J. Control 67 (1997) 713-730.

    Examples
    --------
    >>> output_frequencies([1.0, 2.0], order=2).tolist()
    [[0.0, 1.0], [2.0, 4.0]]
    """
    order = whole_order(order)
    low, high = checked_band(band, "rad/s")
    if not math.isfinite(order * high):
        raise ModelError(f"the band goes up to {high:g} rad/s; sums of {order} such frequencies overflow")
    sums = [((order - k) * low - k * high, (order - k) * high - k * low) for k in range(order + 1)]
    positive = [piece for interval in sums for piece in _magnitudes(*interval)]
    if sample_time is None:
        return read_only(union_of(positive, _ROUNDING * (order * high)))
    nyquist = np.pi / checked_sample_time(sample_time)
    if high > nyquist * (1 + _ROUNDING):
        raise ModelError(f"the band goes up to {high:g} rad/s, beyond half the sampling rate, {nyquist:.6g} rad/s")
    folded = (piece for interval in positive for piece in _folded(*interval, nyquist))
    return read_only(union_of(folded, _ROUNDING * nyquist))


def checked_band(band: ArrayLike, unit: str) -> tuple[float, float]:
    """Return the lowest and the highest frequency of a band after a check. Shapes: `band` (2,)."""
    values = real_numbers(band, "the band")
    if values.shape != (2,) or not (np.all(np.isfinite(values)) and 0 <= values[0] <= values[1]):
        raise ModelError(f"the band is {band!r}; it must be two numbers (low, high) in {unit} with 0 <= low <= high")
    return float(values[0]), float(values[1])


def checked_sample_time(sample_time: float) -> float:
    """Return a sampling interval after a check."""
    found = real_number(sample_time, "sample_time")
    if not 0 < found < math.inf:
        raise ModelError(f"sample_time = {sample_time}; it must be positive, in s")
    return found


def _magnitudes(low: float, high: float) -> list[tuple[float, float]]:
    """Return the absolute values of an interval that may contain both signs."""
    if low >= 0:
        return [(low, high)]
    return [(-high, -low)] if high <= 0 else [(0.0, max(-low, high))]


def _folded(low: float, high: float, nyquist: float) -> list[tuple[float, float]]:
    """Cut an interval at multiples of half the sampling rate, and reverse every second piece."""
    first = math.floor(low / nyquist)
    last = max(math.ceil(high / nyquist), first + 1)
    pieces = []
    for m in range(first, last):
        start, end = (min(max(w - m * nyquist, 0.0), nyquist) for w in (low, high))
        pieces.append((start, end) if m % 2 == 0 else (nyquist - end, nyquist - start))
    return pieces


AMPLIFICATION = 5.0  # Largest sum of the weights' magnitudes, which sum to one: beyond it, G_n is erratic

_CANCELLED = 1e-12  # powers below this share of the largest are rounding
_SMALLEST = float(np.finfo(np.float64).tiny) / _CANCELLED
_COUNTED = 1e-3  # -60 dB: lines whose contributions are below this share of the largest are skirts of the signal


@dataclass(frozen=True, kw_only=True, eq=False)
class InputSpectrum(Described):
    """Spectrum U_n of the n-th power of an input.

    Let U be the spectrum of the input and Y_n that of the n-th order of the output. At the line k, the nonlinear output
    frequency response G_n = Y_n / U_n is a weighted mean of the generalised frequency response H_n over all
    combinations of lines k_1, ..., k_n that add up to k. The weights are U(k_1) ... U(k_n) / U_n(k). They are complex
    and sum to one. If contributions to U_n(k) cancel, the weights are large, and G_n can lie far outside the range of
    H_n.

    Parameters
    ----------
    order : int
        Power n of the input.
    values : ndarray of complex, shape (n_lines,)
        Fourier coefficients U_n, in ``unit``, at all lines of the period up to half the sampling rate.
    in_phase : ndarray, shape (n_lines,)
        Magnitude that U_n would have if all contributions were in phase, in ``unit``: the n-fold convolution of |U|.
    in_range : ndarray of bool, shape (n_lines,)
        True for lines that are sums of n lines of the input.
    omega : ndarray, shape (n_lines,)
        Angular frequencies of the lines, rad/s.
    unit : str
        Unit of the values.
    """

    order: int = field(metadata=attribute())
    values: Complex = field(metadata=variable("frequency", name="", unit=attrgetter("unit")))
    in_phase: Array = field(metadata=variable("frequency", unit=attrgetter("unit")))
    in_range: Booleans = field(metadata=variable("frequency"))
    omega: Array
    unit: str

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "amplification": variable("frequency"),
        "frequency": coordinate("frequency", of=attrgetter("frequency_Hz"), unit="Hz"),
    }

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies of the lines, Hz, shape (n_lines,)."""
        return self.omega / (2 * np.pi)

    @property
    def defined(self) -> Booleans:
        """True where G_n exists, shape (n_lines,): at lines of `in_range` at which U_n exceeds rounding errors."""
        return np.asarray(self.in_range & (np.abs(self.values) > _CANCELLED * self.in_phase.max()), dtype=np.bool_)

    @property
    def amplification(self) -> Array:
        """Sum of the magnitudes of the weights of G_n, shape (n_lines,).

        The sum is 1 if all contributions to U_n are in phase, infinite if they cancel, and NaN outside the range.
        """
        found = np.where(self.in_range, np.inf, np.nan)
        np.divide(self.in_phase, np.abs(self.values), out=found, where=self.defined)
        return found

    @property
    def largest_amplification(self) -> float:
        """Largest `amplification`, over the lines at which `in_phase` is within 60 dB of its maximum."""
        counted = self.in_range & (self.in_phase >= _COUNTED * self.in_phase.max())
        return float(self.amplification[counted].max())

    @property
    def suitable(self) -> bool:
        """True if `largest_amplification` is at most 5, so that G_n is not erratic."""
        return self.largest_amplification <= AMPLIFICATION

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the magnitude of U_n and `in_phase` over frequency, on `ax` or new axes."""
        axes = axes_or_new(ax)
        inside = self.in_range
        frequencies = self.frequency_Hz[inside]
        axes.plot(frequencies, self.in_phase[inside], color="0.6", label="all contributions in phase")
        axes.plot(frequencies, np.abs(self.values[inside]), ".", label=f"$|U_{self.order}|$")
        axes.set(yscale="log", xlabel="frequency (Hz)")
        axes.set_ylabel(f"input spectrum ({written_unit(self.unit)})" if self.unit else "input spectrum")
        axes.legend()
        return axes


@taking(unit=instance(str))
def input_spectrum(excitation: ArrayLike, order: int, sample_time: float, *, unit: str = "") -> InputSpectrum:
    """Compute the spectrum of the n-th power of a periodic input.

    Parameters
    ----------
    excitation : array_like, shape (n_samples,)
        One period of the input as deviations from the operating input, in its unit.
    order : int
        Power n of the input, at least 1.
    sample_time : float
        Sampling time, s.
    unit : str
        Unit of the input.

    Returns
    -------
    InputSpectrum
        Spectrum at all lines of the period from 0 to half the sampling rate.

    Raises
    ------
    ModelError
        If an argument is invalid, if the excitation is zero, or if its power leaves the range of double precision.

    References
    ----------
    Lang, Billings, "Energy transfer properties of non-linear systems in the frequency domain", Int. J. Control 78
    (2005) 345-362, doi:10.1080/00207170500095759.
    """
    period = one_period(excitation, checked_sample_time(sample_time))
    return product_spectrum(period[None], [whole_order(order)], sample_time, (unit,))


def product_spectrum(periods: Array, powers: Sequence[int], sample_time: float, units: Sequence[str]) -> InputSpectrum:
    """Return the spectrum of a product of powers of inputs. Shapes: `periods` (n_inputs, n); `powers` (n_inputs,)."""
    taken = [(period, power, unit) for period, power, unit in zip(periods, powers, units, strict=True) if power]
    if not all(np.any(period) for period, _, _ in taken):
        raise ModelError("the excitation is zero throughout; it has no spectrum to divide by")
    n, order = periods.shape[1], sum(powers)
    spectra = [spectrum_of(period) for period, _, _ in taken]
    excited = [excited_lines(spectrum) for spectrum in spectra]
    waves = [n * np.fft.irfft(np.where(lines, np.abs(u), 0.0), n) for u, lines in zip(spectra, excited, strict=True)]
    with np.errstate(over="ignore", invalid="ignore"):
        values = spectrum_of(np.prod([period**power for period, power, _ in taken], axis=0))
        in_phase = spectrum_of(np.prod([w**power for w, (_, power, _) in zip(waves, taken, strict=True)], axis=0)).real
    if not (np.all(np.isfinite(values)) and _SMALLEST < in_phase.max() < np.inf):
        raise ModelError(
            f"the power {order} of an excitation up to {np.abs(periods).max():.3g} leaves the range of double "
            "precision; choose another amplitude, another unit or a lower order"
        )
    in_range = _reached([lines for lines, (_, power, _) in zip(excited, taken, strict=True) for _ in range(power)], n)
    return InputSpectrum(
        order=order,
        values=values,
        in_phase=np.where(in_range, in_phase, 0.0),
        in_range=in_range,
        omega=line_frequencies(n, sample_time),
        unit=_unit([(unit, power) for _, power, unit in taken]),
    )


def _unit(powers: Sequence[tuple[str, int]]) -> str:
    """Return a product of powers of units; empty if one is unknown."""
    written = [f"{unit}^{power}" if power > 1 else unit for unit, power in powers]
    return " ".join(written) if all(unit for unit, _ in powers) else ""


def _reached(excited: Sequence[Booleans], n: int) -> Booleans:
    """Return the lines reached by sums of one excited line per factor, modulo the period's n lines."""
    reached = excited[0]
    for more in excited[1:]:
        once = np.fft.irfft(more.astype(np.float64), n)
        ways = np.fft.rfft(np.fft.irfft(reached.astype(np.float64), n) * once) * n
        reached = ways.real > 0.5
    return np.asarray(reached, dtype=np.bool_)
