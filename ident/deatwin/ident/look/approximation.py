"""The result of a best linear approximation (response, noise, odd and even distortions) in words and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.amplitudes import axis_label, written_amplitude
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Frozen
from deatwin.plant.drawing import Axes, panels_or_new, written_unit
from deatwin.plant.prefixes import with_unit

Lines = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class BestLinearApproximation(Frozen):
    """Best linear approximation of a recorded system, with the noise and the nonlinear distortion of the output.

    The amplitude of a signal y at a spectral line is the magnitude of its Fourier coefficient,
    (1/n) sum_k y(k) e^(-jwkT). Here n is the number of samples, w the angular frequency and T the sample time. The rms
    of y over time is the square root of twice the sum of its squared amplitudes.

    Parameters
    ----------
    frequencies : ndarray, shape (n_lines,)
        Frequencies of the excited lines, Hz.
    response : ndarray of complex, shape (n_lines,)
        Best linear approximation, output unit per input unit.
    variance : ndarray, shape (n_lines,)
        Variance E|G - E G|^2 of the response G due to noise and distortion, in the square of its unit.
    noise_variance : ndarray, shape (n_lines,)
        Part of `variance` that is due to noise, in the same unit. A recording with more periods would reduce it.
    dof : float
        Degrees of freedom of `variance`.
    complete : bool
        True if `variance` includes the distortion. This requires several realisations or detection lines.
    all_frequencies : ndarray, shape (n_all,)
        Frequencies of all spectral lines above 0 and below half the sampling rate, Hz.
    excited : ndarray of bool, shape (n_all,)
        True at the excited lines.
    odd : ndarray of bool, shape (n_all,)
        True at the odd harmonics of the period.
    output : ndarray, shape (n_all,)
        Root mean square, over the realisations, of the output's amplitude at each line, output unit.
    noise : ndarray, shape (n_all,)
        Standard deviation, due to noise, of the output's Fourier coefficient averaged over the periods of a
        realisation, output unit.
    distortion_variance : ndarray, shape (n_all,)
        Squared amplitude of the nonlinear distortion at each line, square of the output unit. The estimate is unbiased
        and may therefore be negative. NaN if the distortion cannot be determined.
    distortion_low : ndarray, shape (3,)
        Lower 95 % bounds of the rms over time of the even distortion, the odd distortion, and both together, output
        unit. 0 if noise alone explains the distortion; NaN if it cannot be determined.
    realisations : int
        Number of realisations of the input, which differ in their random phases.
    periods : int
        Number of periods that were used, summed over the realisations.
    left_out : int
        Number of periods that were left out because the output was not yet in its steady state, summed over the
        realisations.
    input_unit, output_unit : str
        Units of input and output; empty if unknown.
    noise_rms : float
        Standard deviation of the noise of a single output sample, output unit.
    """

    frequencies: Array
    response: Complex
    variance: Array
    noise_variance: Array
    dof: float
    complete: bool
    all_frequencies: Array
    excited: Lines
    odd: Lines
    output: Array
    noise: Array
    distortion_variance: Array
    distortion_low: Array
    realisations: int
    periods: int
    left_out: int
    input_unit: str
    output_unit: str
    noise_rms: float

    @property
    def separates(self) -> bool:
        """True if only odd lines are excited, so that even and odd distortion appear on different lines."""
        return bool(self.odd[self.excited].all())

    @property
    def even_rms(self) -> float:
        """Rms over time of the even distortion, output unit; NaN if even and odd distortion cannot be separated."""
        return self._rms(~self.odd) if self.separates else float("nan")

    @property
    def odd_rms(self) -> float:
        """Rms over time of the odd distortion, output unit; NaN if it cannot be determined."""
        return self._rms(self.odd) if self.separates else float("nan")

    def _rms(self, lines: Lines) -> float:
        return float(np.sqrt(2.0 * np.maximum(np.sum(self.distortion_variance[lines]), 0.0)))

    def radius(self, probability: float = 0.95) -> Array:
        """Return the radii of the confidence discs about ``response``, shape (n_lines,), in its unit.

        Each disc contains the true value with the given `probability`.
        """
        from scipy.special import fdtri

        return np.asarray(np.sqrt(self.variance * fdtri(2.0, self.dof, probability)))

    def __str__(self) -> str:
        def size(value: float) -> str:
            return f"{with_unit(value, self.output_unit)} rms" if np.isfinite(value) else "unknown"

        drawn = f"{self.realisations} realisation{'s' if self.realisations > 1 else ''}, {self.periods} periods"
        lines = f"{self.frequencies.size} line{'s' if self.frequencies.size > 1 else ''}"
        text = f"best linear approximation at {lines} from {drawn}"
        if self.left_out:
            text += f" (not counting {self.left_out}, in which the output settles)"
        text += f": noise {size(self.noise_rms)}"

        def part(name: str, value: float, low: float) -> str:
            if low == 0.0:
                return f", no {name} above the noise"
            return f", {name} {size(value)}" + (f" (at least {with_unit(low, self.output_unit)})" if low > 0.0 else "")

        even, odd, both = self.distortion_low
        if self.separates:
            return text + part("even distortion", self.even_rms, even) + part("odd distortion", self.odd_rms, odd)
        if self.complete:
            return text + part("nonlinear distortion", self._rms(np.isfinite(self.distortion_variance)), both)
        return (
            text
            + ", nonlinear distortion unknown: to determine it, excite only odd harmonics and leave some of them out, or record the input with several sets of random phases"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the approximation as plain data for JSON; frequencies in Hz, values in the channels' units."""

        def number(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return {
            "realisations": self.realisations,
            "periods": self.periods,
            "left_out": self.left_out,
            "noise_rms": self.noise_rms,
            "even_rms": number(self.even_rms),
            "odd_rms": number(self.odd_rms),
            "even_rms_low": number(self.distortion_low[0]),
            "odd_rms_low": number(self.distortion_low[1]),
            "distortion_known": self.complete,
            "frequency_Hz": self.frequencies.tolist(),
            "gain": np.abs(self.response).tolist(),
            "phase_deg": np.degrees(np.angle(self.response)).tolist(),
            "std": np.sqrt(self.variance).tolist(),
            "noise_std": np.sqrt(self.noise_variance).tolist(),
        }

    def plot(self, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
        """Draw the gain with its standard deviations, and the amplitude of the output, on two `axes` or new ones."""
        gain, output = chosen = panels_or_new(axes, 2, height=2.6)
        unit, size = written_amplitude(self.output_unit)
        gain.plot(
            self.frequencies,
            np.abs(self.response) / size,
            ".",
            color="C0",
            markersize=3,
            label="best linear approximation",
        )
        named = "noise and distortion" if self.complete else "noise only; distortion unknown"
        gain.plot(
            self.frequencies,
            np.sqrt(self.variance) / size,
            color="C3",
            linewidth=1.0,
            label=f"standard deviation, {named}",
        )
        gain.plot(self.frequencies, np.sqrt(self.noise_variance) / size, color="0.5", linewidth=1.0, label="of noise")
        units = f"{unit or self.output_unit}/{self.input_unit}" if self.output_unit and self.input_unit else ""
        gain.set(ylabel=f"gain ({written_unit(units)})" if units else "gain", yscale="log", xlabel="frequency (Hz)")
        parts = [(self.excited, ".", "C0", "output, excited lines")]
        if self.separates:
            parts += [
                (~self.excited & self.odd, "^", "C3", "odd distortion"),
                (~self.odd, "o", "C2", "even distortion"),
            ]
        else:
            parts += [(~self.excited, "^", "C3", "detection lines")]
        for lines, marker, colour, name in parts:
            if lines.any():
                output.plot(
                    self.all_frequencies[lines],
                    self.output[lines] / size,
                    marker,
                    color=colour,
                    markersize=3,
                    label=name,
                )
        noise = self.noise / size
        output.plot(self.all_frequencies, noise, color="0.5", linewidth=1.0, label="standard deviation of noise")
        output.set(ylabel=axis_label("amplitude", unit), yscale="log", xlabel="frequency (Hz)")
        for panel in chosen:
            panel.legend(fontsize="small", ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
        return chosen
