"""Compare settled free runs under periodic inputs with NOFRFs and with the sum of the orders of an output."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.dc import deviations
from deatwin.ident.frequency.output_responses.estimate import nofrf_exact
from deatwin.ident.frequency.output_responses.excitation import TestSignal
from deatwin.ident.frequency.output_responses.powers import output_frequencies
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfWarning
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.spectrum import output_orders, spectrum_of
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

PERIODS = 40  # Periods until an output is settled: with 200 samples a period a pole of 0.9 is then at 1e-366


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """NOFRFs of a model under a test signal, by least squares over levels and exactly, and the simulated output."""

    fitted: Nofrf
    direct: tuple[FrequencyResponse, ...]  # G_1, G_2, ... from the model, without truncation
    simulated: Complex  # shape (n_lines,): Fourier coefficients of the settled free run

    @property
    def errors(self) -> Array:
        """Largest error of each G_n, relative to the largest gain if there is one, shape (n_orders,)."""
        pairs = zip(self.fitted.orders, self.direct, strict=False)
        return np.array([np.abs(g.values - d.values).max() / (d.gain.max() or 1.0) for g, d in pairs])

    @property
    def line_errors(self) -> Array:
        """Largest error of each G_n U_n of least squares, relative to the output's largest line, shape (n_orders,)."""
        every = zip(self.fitted.orders, self.direct, self.fitted.inputs, strict=False)
        errors = [float(np.abs((g.values - d.values) * u.values[u.defined]).max()) for g, d, u in every]
        return np.array(errors) / np.abs(self.simulated).max()

    @property
    def sum_error(self) -> float:
        """Largest error of the sum of G_n U_n, relative to the largest line of the simulated output."""
        outputs = np.array([y.values for y in self.fitted.outputs])
        error = np.abs(np.ones(len(outputs)) @ outputs - self.simulated)
        return float(error.max() / np.abs(self.simulated).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderRanges:
    """The orders of an output under a band-limited signal, and the ranges where they may have energy."""

    signal: TestSignal
    frequency_Hz: Array  # shape (n_lines,)
    simulated: Complex  # shape (n_lines,): Fourier coefficients of the settled free run
    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ...
    bands_Hz: tuple[Array, ...]  # shape (k, 2): predicted ranges of each order

    @property
    def outside(self) -> float:
        """Largest share of an order's energy outside its range."""
        every = zip(self.orders, self.bands_Hz, strict=True)
        return max(power_outside(y.values, self.frequency_Hz, band) for y, band in every)

    @property
    def simulated_outside(self) -> float:
        """Share of the simulated output's energy outside all these ranges."""
        return power_outside(self.simulated, self.frequency_Hz, np.concatenate(self.bands_Hz))


def order_ranges(model: NarxModel, signal: TestSignal, orders: int) -> OrderRanges:
    """Compute the first orders of an output, the settled free run, and the predicted ranges."""
    found = output_orders(model, signal.values, orders)
    band = 2 * np.pi * np.array(signal.band_Hz)
    return OrderRanges(
        signal=signal,
        frequency_Hz=found[0].frequency_Hz,
        simulated=settled(model, signal.values),
        orders=found,
        bands_Hz=tuple(output_frequencies(band, n) / (2 * np.pi) for n in range(1, orders + 1)),
    )


def evaluate(
    model: NarxModel, signal: TestSignal, fitted: Nofrf, orders: int, operating_input: ArrayLike | None = None
) -> Evaluated:
    """Compare the first orders of NOFRFs by least squares with the exact ones, and their sum with a simulation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)  # the status of the fit states it
        direct = [nofrf_exact(model, signal.values, n + 1, operating_input=operating_input) for n in range(orders)]
    moved = model if operating_input is None else deviations(model, operating_input).model
    return Evaluated(fitted=fitted, direct=tuple(direct), simulated=settled(moved, signal.values))


def settled(model: NarxModel, period: Array) -> Complex:
    """Run a model free until it repeats; return the last period's spectrum, (n_samples // 2 + 1,)."""
    inputs = np.tile(period, PERIODS)
    run = model.simulate(Recording.from_arrays(inputs, np.zeros_like(inputs), model.sample_time))
    return spectrum_of(run.outputs[0, -period.size :])


def left_by_orders(model: NarxModel, period: Array, highest: int, operating_input: ArrayLike) -> Array:
    """Return the share of the settled free run, without mean, that the first 1, 2, ... orders leave, (highest,)."""
    run = settled(deviations(model, operating_input).model, period)
    orders = output_orders(model, period, highest, operating_input=operating_input)
    rest = run - np.cumsum([order.values for order in orders], axis=0)
    power = [np.sum(np.abs(spectra[:, 1:]) ** 2, axis=1) for spectra in (rest, run[None])]
    return np.asarray(np.sqrt(power[0] / power[1]))


def in_bands(frequency_Hz: Array, bands_Hz: Array) -> NDArray[np.bool_]:
    """True for lines in one of several bands, (n_lines,). Shapes: `bands_Hz` (k, 2)."""
    low, high = bands_Hz.T[..., None]
    return np.asarray(((frequency_Hz > low - 1e-9) & (frequency_Hz < high + 1e-9)).any(axis=0))


def power_outside(values: Complex, frequency_Hz: Array, bands_Hz: Array) -> float:
    """Share of a spectrum's power outside several bands. Shapes: `values, frequency_Hz` (n_lines,); `bands_Hz` (k, 2)."""
    power = np.abs(values) ** 2
    return float(power[~in_bands(frequency_Hz, bands_Hz)].sum() / power.sum()) if power.any() else 0.0


TONE_PERIODS = 3  # Periods of the lowest tone; the first ones let the plant settle


def tone_response(
    plant: Plant, frequency_Hz: Sequence[float], size: float, operating_input: float
) -> NDArray[np.complex128]:
    """Measure the response (n_frequencies,) to tones of both signs, so that even orders cancel."""
    step = plant.rig.sample_time
    n = round(1 / frequency_Hz[0] / step)
    lines = np.round(np.array(frequency_Hz) * n * step).astype(int)
    phases = np.arange(lines.size)[:, None] ** 2  # keeps the peaks of the tones apart
    period = np.cos(2 * np.pi * np.outer(lines, np.arange(n)) / n + phases).sum(axis=0)
    period *= size / np.abs(period).max()

    def answer(sign: int) -> NDArray[np.complex128]:
        commands = operating_input + np.tile(sign * period, TONE_PERIODS)
        record = Recording.from_arrays(commands, np.zeros_like(commands), step)
        run = plant.simulate(Experiment(recordings=(record,))).require().outputs[-1][0, -n:]
        return np.asarray(np.fft.rfft(run)[lines])

    return np.asarray((answer(1) - answer(-1)) / 2 / np.fft.rfft(period)[lines])
