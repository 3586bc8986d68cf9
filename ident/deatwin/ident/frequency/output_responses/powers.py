"""Spectra of the powers of an input, and whether they suit nonlinear output frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.frequency.checks import whole_order
from deatwin.ident.frequency.output_responses.ranges import checked_sample_time
from deatwin.ident.frequency.spectrum import excited_lines, line_frequencies, one_period, spectrum_of
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array, Booleans, Complex
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new, written_unit
from deatwin.plant.errors import ModelError

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
