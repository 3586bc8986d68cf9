"""The output's short-time spectrum, as the TV-NOFRFs predict it from the input, and as it was recorded.

In each window, the input's deviations are one period, and the model of its middle answers Y = G_1 U_1 + ... + G_N U_N. A
Hann window over answer and recording hides the seam of the period and makes leakage equal.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import output_spectrum, remove_dc
from deatwin.ident.frequency.output_responses.powers import input_spectrum
from deatwin.ident.frequency.output_responses.result import NofrfWarning
from deatwin.ident.frequency.varying.along_time import tv_nofrf
from deatwin.ident.narx import NarxModel, Recording, ThetaTrajectory
from deatwin.plant.arrays import Array, Complex, root_mean_square

HIGHEST = 5  # N: the degree of the fleet's models, which have no higher order
PERIODS = 10  # Periods after which a free run counts as steady
BANDS = ((0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 3.0))
"""Bands, Hz, in which powers are compared. They begin at the third line of a window of 20 s, because the mean is
removed. Up to 1 Hz there is input; above, only what the nonlinearity generates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortTime:
    """Short-time spectra of a recording, and the predicted ones."""

    timepts: Array  # shape (n_windows,): Middle of each window, s
    frequencies: Array  # shape (n,): Hz
    recorded: Complex  # shape (n_windows, n): Amplitudes of the recorded output
    predicted: Mapping[str, Complex]  # shape (n_windows, n): Amplitudes of each prediction

    def power_ratio_dB(self, name: str, band: tuple[float, float]) -> Array:
        """Predicted power in a band, Hz, divided by the recorded power, in dB, shape (n_windows,)."""
        inside = self._inside(band)
        powers = [np.sum(np.abs(s[:, inside]) ** 2, axis=1) for s in (self.predicted[name], self.recorded)]
        return np.asarray(10 * np.log10(powers[0] / powers[1]))

    def error(self, name: str, band: tuple[float, float]) -> float:
        """Rms difference of predicted and recorded lines in a band, Hz, relative to the recorded ones."""
        inside = self._inside(band)
        missed = np.sum(np.abs(self.predicted[name] - self.recorded)[:, inside] ** 2)
        return float(np.sqrt(missed / np.sum(np.abs(self.recorded[:, inside]) ** 2)))

    def _inside(self, band: tuple[float, float]) -> NDArray[np.bool_]:
        return (self.frequencies >= band[0] - 1e-9) & (self.frequencies < band[1] - 1e-9)


def windows_of(recording: Recording, length: float) -> list[Recording]:
    """Cut a recording into windows that overlap by half."""
    size = 2 * (round(length / recording.sample_time) // 2)
    starts = range(0, recording.n_samples - size + 1, size // 2)
    return [recording.section(first, first + size) for first in starts]


def compare_windows(
    windows: Sequence[Recording], sources: Mapping[str, NarxModel | ThetaTrajectory], operating_input: float
) -> ShortTime:
    """Predict the spectrum of each window from its input, and compute the recorded spectrum."""
    middles = np.array([0.5 * (w.start + w.end) for w in windows])
    step = windows[0].sample_time
    recorded = [short_time(w.outputs[0], step) for w in windows]
    found = {
        name: np.stack(
            [
                short_time(predicted(source, w.inputs[0] - operating_input, middle, operating_input), step)[1]
                for w, middle in zip(windows, middles.tolist(), strict=True)
            ]
        )
        for name, source in sources.items()
    }
    return ShortTime(
        timepts=middles, frequencies=recorded[0][0], recorded=np.stack([r for _, r in recorded]), predicted=found
    )


def predicted(source: NarxModel | ThetaTrajectory, period: Array, time: float, operating_input: float) -> Array:
    """Return one period of the output's deviation, Y = G_1 U_1 + ... + G_N U_N. Shapes: `period`, result (n,)."""
    # G_n U_n is Y_n: for a random record G_n is erratic where its powers cancel, but the product is not.
    model = source if isinstance(source, NarxModel) else source.at(time)
    spectrum = output_spectrum(model, period, HIGHEST, operating_input=operating_input).values
    return np.asarray(np.fft.irfft(spectrum * period.size, period.size))


def series_error(trajectory: ThetaTrajectory, window: Recording, operating_input: float) -> float:
    """Return the error of the sum of G_n U_n, for each number of orders, against a window's free run."""
    period, middle = window.inputs[0] - operating_input, 0.5 * (window.start + window.end)
    spectrum = np.zeros(period.size // 2 + 1, dtype=np.complex128)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)  # an erratic G_n is harmless in its product with U_n
        for order in range(1, HIGHEST + 1):
            powers = input_spectrum(period, order, window.sample_time)
            response = tv_nofrf(trajectory, period, order, timepts=[middle], operating_input=operating_input)
            spectrum[powers.defined] += response.values[0] * powers.values[powers.defined]
    summed = np.fft.irfft(spectrum * period.size, period.size)
    model = remove_dc(trajectory.at(middle), operating_input)
    tiled = Recording.from_arrays(np.tile(period, PERIODS), np.zeros(PERIODS * period.size), window.sample_time)
    steady = model.simulate(tiled).outputs[0, -period.size :]
    return root_mean_square(summed - steady) / root_mean_square(steady)


def short_time(values: Array, sample_time: float) -> tuple[Array, Complex]:
    """Frequencies, Hz, and amplitudes of a window, as `scipy.signal.ShortTimeFFT` has them. Shapes: `values` (n,)."""
    from scipy.signal import ShortTimeFFT
    from scipy.signal.windows import hann

    window = hann(values.size, sym=False)
    transform = ShortTimeFFT(window, hop=values.size // 2, fs=1 / sample_time, scale_to="magnitude")
    middle = transform.stft(values - values.mean(), p0=1, p1=2)  # the only slice that lies exactly on the samples
    return np.asarray(transform.f), np.asarray(middle[:, 0], dtype=np.complex128)
