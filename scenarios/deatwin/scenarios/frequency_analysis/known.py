"""Benchmark systems whose responses can be written down: closed forms, output ranges, NOFRFs, outputs with bands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.frequency import FrequencyResponse, TestSignal, design_excitation, nofrf, output_orders
from deatwin.ident.frequency.closed_forms import DUFFING, HAMMERSTEIN, SYSTEMS, ClosedForm
from deatwin.ident.frequency.output_responses.settled import Evaluated, OrderRanges, evaluate, order_ranges
from deatwin.ident.narx import Fixed, NarxModel, SvbNarx
from deatwin.ident.narx.systems import SYSTEMS as RANDOM_SYSTEMS
from deatwin.plant.arrays import Array

SIGNAL_BAND, NARROW = (0.0, 0.1), (0.06, 0.09)
"""Bands of the test signals, Hz, at 1 s: for the NOFRFs, and for the ranges, which then have gaps."""
PERIOD, PEAK = 200.0, 0.5
ORDERS = 3
REALISATIONS, IDENTIFIED_ON = 300, 1000
NAME = "S2"  # Name of the system that is identified


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

    errors: Mapping[str, Mapping[int, float]]  # Error of each order against the closed form, by system
    ranges: Mapping[ClosedForm, OrderRanges]
    evaluated: Mapping[ClosedForm, Evaluated]
    identified: Identified


def known_systems(rng: np.random.Generator, *, recordings: int = REALISATIONS) -> Known:
    """Analyse the benchmark systems."""
    chosen = (HAMMERSTEIN, DUFFING)
    return Known(
        errors={system.name: system.errors() for system in SYSTEMS},
        ranges={system: order_ranges(system.model, _signal(system, NARROW), ORDERS) for system in chosen},
        evaluated={system: _evaluated(system) for system in chosen},
        identified=_identified(rng, recordings),
    )


def _signal(system: ClosedForm, band_Hz: tuple[float, float]) -> TestSignal:
    return design_excitation(band_Hz, system.model.sample_time, amplitude=PEAK, period=PERIOD)


def _evaluated(system: ClosedForm) -> Evaluated:
    signal = _signal(system, SIGNAL_BAND)
    return evaluate(system.model, signal, nofrf(system.model, signal, ORDERS), ORDERS)


def _identified(rng: np.random.Generator, recordings: int) -> Identified:
    system = RANDOM_SYSTEMS[NAME]
    signal = design_excitation(SIGNAL_BAND, system.sample_time, amplitude=PEAK, period=PERIOD)
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
