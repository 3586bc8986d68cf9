"""What is done with the benchmark systems: propagation beside draws, coverage, and where the law fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, output_orders
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.uncertainty.beside_draws import Spread, spread_of
from deatwin.ident.frequency.uncertainty.propagate import propagate
from deatwin.ident.narx import NarxModel
from deatwin.scenarios.frequency_uncertainty.speed import Speed
from deatwin.scenarios.frequency_uncertainty.systems import AT, BILINEAR, LINEAR, NOTCH, Case

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DATA_SETS = 400
"""From which each system is identified, for the coverage."""
SCALES = tuple(2.0**power for power in range(-1, 6))
"""Of the deviations of the parameters, over those identified."""
CURVE = 800
"""Frequencies of a response that is drawn as a line."""
SURFACE = 65
"""Frequencies of H_2 along each axis."""
PERIOD, HARMONICS, AMPLITUDE = 64, range(3, 9), 0.1
"""Samples of the multisine, its harmonics, and the amplitude of each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Propagation beside draws, with the parameters known better and worse."""

    label: str
    scales: Array  # shape (n,): Of the parameters' deviations
    ratios: Array  # shape (n,): The draws' variance over the propagated one, where it is furthest from one
    held: Array  # shape (n,): Share of the draws in the 95 % region, where it is furthest from 95 %
    indices: Array  # shape (n,): The largest nonlinearity over the frequencies
    holds: Flags  # shape (n,): Whether propagation says that its law holds at all frequencies


@dataclass(frozen=True, kw_only=True, eq=False)
class Benchmarks:
    """All that was done."""

    cases: Mapping[str, tuple[Spread, ...]]
    fragile: Mapping[str, tuple[Spread, ...]]
    coverage: Mapping[tuple[str, int], Flags]
    sweeps: tuple[Sweep, ...]
    spectra: tuple[Spread, ...]  # Orders of the output of `BILINEAR`
    surface: FrequencyResponse  # H_2 of `BILINEAR` over both frequencies
    speeds: tuple[Speed, ...]

    @property
    def linear(self) -> Spread:
        """H_1 of the linear system."""
        return self.cases[LINEAR][0]

    @property
    def notch(self) -> Spread:
        """H_1 of the system whose gain vanishes at one frequency."""
        return self.fragile[NOTCH.name][0]

    @property
    def bilinear(self) -> tuple[Spread, ...]:
        """H_1, H_2, H_3 of the bilinear one."""
        return self.cases[BILINEAR]


def spreads(case: Case, seed: tuple[int, ...]) -> tuple[Spread, ...]:
    """Identify a case once; propagate to each order and draw."""
    rng = np.random.default_rng(seed)
    model = case.identify(rng)
    return tuple(
        spread_of(case.name, model, case.response(order), rng, case.response(order, CURVE)(model).values)
        for order in case.orders
    )


def covered(case: Case, seed: tuple[int, ...], n_sets: int = DATA_SETS) -> dict[int, Flags]:
    """Identify a case from many recordings and look whether the regions hold the truth. Shapes: returns (n_sets,
    n_frequencies).
    """
    rng = np.random.default_rng(seed)
    truth = {order: case.response(order)(case.truth).values for order in case.orders}
    found: dict[int, list[Flags]] = {order: [] for order in case.orders}
    for _ in range(n_sets):
        model = case.identify(rng)
        for order, flags in found.items():
            flags.append(propagate(model, case.response(order)).contains(truth[order]))
    return {order: np.array(flags) for order, flags in found.items()}


def sweep(case: Case, order: int, seed: tuple[int, ...]) -> Sweep:
    """Propagate and draw with the parameters known better and worse than they are."""
    rng = np.random.default_rng(seed)
    model = case.identify(rng)
    rows = [
        spread_of(case.name, replace(model, theta_cov=scale**2 * model.theta_cov), case.response(order), rng)
        for scale in SCALES
    ]
    return Sweep(
        label=f"{rows[0].symbol} of {case.name.split(',')[0]}",
        scales=np.array(SCALES),
        ratios=np.array([row.ratio for row in rows]),
        held=np.array([row.held for row in rows]),
        indices=np.array([row.propagated.nonlinearity.max() for row in rows]),
        holds=np.array([bool(row.propagated.linear_law.all()) and row.propagated.lost == 0 for row in rows]),
    )


def spectra(case: Case, seed: tuple[int, ...]) -> tuple[Spread, ...]:
    """Propagate to the orders of the output of a multisine, and draw."""
    rng = np.random.default_rng(seed)
    model = case.identify(rng)
    phases = rng.uniform(0, 2 * np.pi, len(HARMONICS))
    angle = 2 * np.pi * np.arange(PERIOD) / PERIOD
    excitation = AMPLITUDE * sum(np.cos(n * angle + phase) for n, phase in zip(HARMONICS, phases, strict=True))
    return tuple(
        spread_of(case.name, model, partial(_lines, excitation=excitation, order=order), rng) for order in (1, 2, 3)
    )


def surface(case: Case, seed: tuple[int, ...]) -> FrequencyResponse:
    """H_2 of a case, identified once, over both frequencies."""
    model = case.identify(np.random.default_rng(seed))
    axis = np.pi / case.system.sample_time * np.linspace(-1, 1, SURFACE)
    return gfrf(model, 2, frequency_grid(axis, axis), operating_input=AT)


def _lines(model: NarxModel, excitation: Array, order: int) -> FrequencyResponse:
    """An order of the output, at the lines where it is complex and not zero."""
    whole = output_orders(model, excitation, order, operating_input=AT)[-1]
    inner = np.arange(1, whole.values.size - 1)
    kept = inner[whole.gain[inner] > 1e-9 * whole.gain.max()]
    return replace(
        whole,
        values=whole.values[kept],
        omega=whole.omega[kept],
        differentiate=partial(_slopes, whole, kept),
        evaluate=partial(_drawn, whole, kept),
    )


def _slopes(whole: FrequencyResponse, kept: NDArray[np.intp]) -> NDArray[np.complex128]:
    return whole.gradient[kept]


def _drawn(whole: FrequencyResponse, kept: NDArray[np.intp], thetas: Array) -> Evaluated:
    if whole.evaluate is None:
        raise ValueError("an order of the output knows its values at many parameters")
    found = whole.evaluate(thetas)
    return replace(found, values=found.values[:, kept])
