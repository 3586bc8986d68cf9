"""What is done with the benchmark systems: closed forms, output ranges, NOFRFs, and outputs with bands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, output_orders
from deatwin.ident.frequency.closed_forms import DUFFING, HAMMERSTEIN, SYSTEMS, ClosedForm
from deatwin.ident.frequency.output_responses.estimate import nofrf, nofrf_exact
from deatwin.ident.frequency.output_responses.excitation import TestSignal, design_excitation
from deatwin.ident.frequency.output_responses.ranges import output_frequencies
from deatwin.ident.frequency.output_responses.result import Nofrf
from deatwin.ident.frequency.spectrum import spectrum_of
from deatwin.ident.narx import Fixed, NarxModel, SvbNarx
from deatwin.ident.narx.systems import SYSTEMS as RANDOM_SYSTEMS
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BAND, NARROW = (0.0, 0.1), (0.06, 0.09)
"""Of the test signals, Hz, at 1 s: for the NOFRFs, and for the ranges, which then have gaps."""
PERIOD = 200.0
PEAK = 0.5
ORDERS = 3
PERIODS = 40
"""Until an output is settled: the slowest pole, 0.894, is then at 1e-390."""
REALISATIONS = 300
IDENTIFIED_ON = 1000
NAME = "S2"
"""Of the system that is identified."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranges:
    """The output of a system whose input has a narrow band."""

    system: ClosedForm  # Which
    signal: TestSignal  # Its input
    frequency_Hz: Array  # shape (n_lines,): Lines of the period
    simulated: Complex  # shape (n_lines,): Fourier coefficients of the settled free run
    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2,
    bands_Hz: tuple[Array, ...]  # shape (k, 2): Predicted ranges of each order

    @property
    def outside(self) -> float:
        """Largest share of an order's energy outside its range."""
        every = zip(self.orders, self.bands_Hz, strict=True)
        return max(_outside(y.values, self.frequency_Hz, band) for y, band in every)

    @property
    def simulated_outside(self) -> float:
        """Share of the simulated output's energy outside all these ranges."""
        return _outside(self.simulated, self.frequency_Hz, np.concatenate(self.bands_Hz))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """NOFRFs of a system, by least squares over levels and directly."""

    system: ClosedForm  # Which
    signal: TestSignal  # The excitation
    fitted: Nofrf
    direct: tuple[FrequencyResponse, ...]  # G_1, G_2, ... from the model, without truncation
    simulated: Complex  # shape (n_lines,): Fourier coefficients of the settled free run

    @property
    def errors(self) -> Array:
        """Largest error of each G_n U_n of least squares, over the largest line of the output, shape (n_orders,)."""
        every = zip(self.fitted.orders, self.direct, self.fitted.inputs, strict=False)
        errors = [float(np.abs((g.values - d.values) * u.values[u.defined]).max()) for g, d, u in every]
        return np.array(errors) / np.abs(self.simulated).max()

    @property
    def sum_error(self) -> float:
        """Largest error of the sum of G_n U_n, over the largest line of the simulated output."""
        error = np.abs(self.fitted.output_spectrum().values - self.simulated)
        return float(error.max() / np.abs(self.simulated).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A system identified from one recording by SVB, and by least squares from many."""

    model: NarxModel
    truth: NarxModel  # The system
    signal: TestSignal  # What excites both
    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... of both
    true_orders: tuple[FrequencyResponse, ...]
    coverage: Array
    recordings: int  # Their number


@dataclass(frozen=True, kw_only=True, eq=False)
class Benchmarks:
    """All of it."""

    errors: Mapping[str, Mapping[int, float]]
    ranges: tuple[Ranges, ...]
    evaluated: tuple[Evaluated, ...]
    identified: Identified  # A system found from a recording


def benchmarks(rng: np.random.Generator, *, recordings: int = REALISATIONS) -> Benchmarks:
    """Analyse the benchmark systems."""
    chosen = (HAMMERSTEIN, DUFFING)
    return Benchmarks(
        errors={system.name: _errors(system) for system in SYSTEMS},
        ranges=tuple(_ranges(system) for system in chosen),
        evaluated=tuple(_evaluated(system) for system in chosen),
        identified=_identified(rng, recordings),
    )


def settled(model: NarxModel, period: Array, *, periods: int = PERIODS) -> Complex:
    """Run a model free until it repeats, and return the spectrum of the last period. Shapes: `period` (n_samples,);
    returns (n_samples // 2 + 1,).
    """
    inputs = np.tile(period, periods)
    run = model.simulate(Recording.from_arrays(inputs, np.zeros_like(inputs), model.sample_time))
    return spectrum_of(run.outputs[0, -period.size :])


def in_ranges(frequency_Hz: Array, bands_Hz: Array) -> NDArray[np.bool_]:
    """Whether lines lie in one of several bands. Shapes: `frequency_Hz` (n_lines,); `bands_Hz` (k, 2); returns
    (n_lines,).
    """
    low, high = bands_Hz.T[..., None]
    return np.asarray(((frequency_Hz > low - 1e-9) & (frequency_Hz < high + 1e-9)).any(axis=0))


def _outside(values: Complex, frequency_Hz: Array, bands_Hz: Array) -> float:
    power = np.abs(values) ** 2
    return float(power[~in_ranges(frequency_Hz, bands_Hz)].sum() / power.sum()) if power.any() else 0.0


def _errors(system: ClosedForm) -> dict[int, float]:
    """On grids over both signs of all frequencies."""
    errors = {}
    for order, response in system.responses.items():
        axis = np.linspace(-3.0, 3.1, 401 if order == 1 else 11 if order < 4 else 7)
        grid = frequency_grid(*[axis] * order)
        values = gfrf(system.model, order, grid[:, 0] if order == 1 else grid).values
        expected = response(grid)
        errors[order] = float(np.abs(values - expected).max() / (np.abs(expected).max() or 1.0))
    return errors


def _ranges(system: ClosedForm) -> Ranges:
    signal = design_excitation(NARROW, system.model.sample_time, amplitude=PEAK, period=PERIOD)
    orders = output_orders(system.model, signal.values, ORDERS)
    band = 2 * np.pi * np.array(signal.band_Hz)
    return Ranges(
        system=system,
        signal=signal,
        frequency_Hz=orders[0].frequency_Hz,
        simulated=settled(system.model, signal.values),
        orders=orders,
        bands_Hz=tuple(output_frequencies(band, n) / (2 * np.pi) for n in range(1, ORDERS + 1)),
    )


def _evaluated(system: ClosedForm) -> Evaluated:
    signal = design_excitation(BAND, system.model.sample_time, amplitude=PEAK, period=PERIOD)
    return Evaluated(
        system=system,
        signal=signal,
        fitted=nofrf(system.model, signal, ORDERS),
        direct=tuple(nofrf_exact(system.model, signal, n) for n in range(1, ORDERS + 1)),
        simulated=settled(system.model, signal.values),
    )


def _identified(rng: np.random.Generator, recordings: int) -> Identified:
    system = RANDOM_SYSTEMS[NAME]
    signal = design_excitation(BAND, system.sample_time, amplitude=PEAK, period=PERIOD)
    found = SvbNarx(output_lags=2, input_lags=2, degree=3).fit(system.draw(rng, IDENTIFIED_ON).recording).model_
    true_orders = output_orders(system.model, signal.values, ORDERS, operating_input=0.0)
    held = np.array(
        [
            [_held(y, truth) for y, truth in zip(_orders(model, signal), true_orders, strict=True)]
            for model in (Fixed(terms=system.terms).fit(system.draw(rng).recording).model_ for _ in range(recordings))
        ]
    )
    return Identified(
        model=found,
        truth=system.model,
        signal=signal,
        orders=_orders(found, signal),
        true_orders=true_orders,
        coverage=held.mean(axis=0),
        recordings=recordings,
    )


def _orders(model: NarxModel, signal: TestSignal) -> tuple[FrequencyResponse, ...]:
    return output_orders(replace(model, operating=None), signal.values, ORDERS, operating_input=0.0)


def _held(response: FrequencyResponse, truth: FrequencyResponse) -> float:
    """Share of the lines that have energy at which the band holds the truth."""
    band, there = response.band(), truth.gain > 1e-9 * truth.gain.max()
    return float(np.mean((band.low <= truth.gain)[there] & (truth.gain <= band.high)[there]))
