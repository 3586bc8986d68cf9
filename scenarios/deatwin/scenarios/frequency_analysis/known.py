"""Benchmark systems whose responses can be written down: closed forms, output ranges, NOFRFs, outputs with bands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, output_orders
from deatwin.ident.frequency.closed_forms import DUFFING, HAMMERSTEIN, SYSTEMS, ClosedForm
from deatwin.ident.frequency.output_responses.estimate import nofrf
from deatwin.ident.frequency.output_responses.excitation import TestSignal, design_excitation
from deatwin.ident.frequency.output_responses.ranges import output_frequencies
from deatwin.ident.frequency.output_responses.settled import Evaluated, evaluate, power_outside, settled
from deatwin.ident.narx import Fixed, NarxModel, SvbNarx
from deatwin.ident.narx.systems import SYSTEMS as RANDOM_SYSTEMS

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BAND, NARROW = (0.0, 0.1), (0.06, 0.09)
"""Bands of the test signals, Hz, at 1 s: for the NOFRFs, and for the ranges, which then have gaps."""
PERIOD, PEAK = 200.0, 0.5
ORDERS = 3
REALISATIONS, IDENTIFIED_ON = 300, 1000
NAME = "S2"
"""Name of the system that is identified."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranges:
    """The output of a system whose input has a narrow band."""

    system: ClosedForm
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A system identified from one recording by SVB, and by least squares from many."""

    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... of the model and of the system
    true_orders: tuple[FrequencyResponse, ...]
    coverage: Array  # shape (n_orders,): share of the lines at which a band holds the truth, over many recordings
    recordings: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """All benchmark systems."""

    errors: Mapping[str, Mapping[int, float]]  # Of each system and order against its closed form
    ranges: tuple[Ranges, ...]
    evaluated: Mapping[ClosedForm, Evaluated]
    identified: Identified


def known_systems(rng: np.random.Generator, *, recordings: int = REALISATIONS) -> Known:
    """Analyse the benchmark systems."""
    chosen = (HAMMERSTEIN, DUFFING)
    return Known(
        errors={system.name: _errors(system) for system in SYSTEMS},
        ranges=tuple(_ranges(system) for system in chosen),
        evaluated={system: _evaluated(system) for system in chosen},
        identified=_identified(rng, recordings),
    )


def _errors(system: ClosedForm) -> dict[int, float]:
    """Largest errors of each order on grids over both signs of all frequencies, over its largest gain."""
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
    return evaluate(system.model, signal, nofrf(system.model, signal, ORDERS), ORDERS)


def _identified(rng: np.random.Generator, recordings: int) -> Identified:
    system = RANDOM_SYSTEMS[NAME]
    signal = design_excitation(BAND, system.sample_time, amplitude=PEAK, period=PERIOD)
    found = SvbNarx(output_lags=2, input_lags=2, degree=3).fit(system.draw(rng, IDENTIFIED_ON).recording).model_
    true_orders = output_orders(system.model, signal.values, ORDERS, operating_input=0.0)
    models = (Fixed(terms=system.terms).fit(system.draw(rng).recording).model_ for _ in range(recordings))
    held = [[_held(*pair) for pair in zip(_orders(model, signal), true_orders, strict=True)] for model in models]
    return Identified(
        orders=_orders(found, signal),
        true_orders=true_orders,
        coverage=np.mean(held, axis=0),
        recordings=recordings,
    )


def _orders(model: NarxModel, signal: TestSignal) -> tuple[FrequencyResponse, ...]:
    return output_orders(replace(model, operating=None), signal.values, ORDERS, operating_input=0.0)


def _held(response: FrequencyResponse, truth: FrequencyResponse) -> float:
    """Share of the lines with energy at which the band holds the truth."""
    band, there = response.band(), truth.gain > 1e-9 * truth.gain.max()
    return float(np.mean((band.low <= truth.gain)[there] & (truth.gain <= band.high)[there]))
