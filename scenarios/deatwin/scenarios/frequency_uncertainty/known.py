"""Benchmark systems: propagation beside draws, coverage, where the law fails, and what propagation costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, propagate
from deatwin.ident.frequency.spectrum import inner_lines
from deatwin.ident.frequency.uncertainty.beside_draws import Speed, Spread, Sweep, speed_of, spread_of, sweep_of
from deatwin.ident.frequency.uncertainty.parameters import Quantity
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

POINTS, CURVE = 40, 800  # Frequencies of a response, and of one that is drawn as a line
AT = 0.0  # Operating input of all systems
LOWEST = 0.02  # Lowest frequency, over half the sampling rate
DATA_SETS = 400  # Recordings from which each system is identified, for the coverage
SCALES = tuple(2.0**power for power in range(-1, 6))  # Deviations of the parameters, over those identified
SURFACE = 65  # Frequencies of H_2 along each axis
PERIOD, HARMONICS, AMPLITUDE = 64, range(3, 9), 0.1
"""Samples of the multisine, its harmonics, and the amplitude of each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A system, the recordings that it is identified from, and the orders of its response."""

    name: str
    system: BenchmarkSystem
    n_samples: int
    orders: tuple[int, ...]

    def identify(self, rng: np.random.Generator) -> NarxModel:
        """Estimate the true terms by least squares from a new recording."""
        return Fixed(terms=self.system.terms).fit(self.system.draw(rng, self.n_samples).recording).model_

    @property
    def short_name(self) -> str:
        """The name up to its first comma."""
        return self.name.split(",")[0]

    def omega(self, order: int, points: int = POINTS) -> Array:
        """Frequencies of a response, all tones equal: (points,) or (points, order), rad/s."""
        harmonic = np.pi / self.system.sample_time * np.linspace(LOWEST, 1 - LOWEST, points)
        return harmonic if order == 1 else np.repeat(harmonic[:, None] / order, order, axis=1)

    def response(self, order: int, points: int = POINTS) -> Quantity:
        """The response as a function of the model."""
        return partial(gfrf, order=order, omega=self.omega(order, points), operating_input=AT)


def _case(name: str, system: BenchmarkSystem, noise: float, n_samples: int, orders: tuple[int, ...]) -> Case:
    return Case(name=name, system=replace(system, noise_std=noise), n_samples=n_samples, orders=orders)


CASES: Mapping[str, Case] = MappingProxyType(
    {
        case.name: case
        for case in (
            _case("S1, linear", SYSTEMS["S1"], 0.1, 500, (1,)),
            _case("S2, powers of the input", SYSTEMS["S2"], 0.01, 500, (1, 2, 3)),
            _case("S6, bilinear", SYSTEMS["S6"], 0.01, 4000, (1, 2, 3)),
            _case("E0, product of outputs", SYSTEMS["E0"], 0.1, 4000, (1, 2, 3)),
        )
    }
)
"""Systems whose parameters are known well enough that the law of propagation, which is linear, should hold."""
LINEAR, POWERS, BILINEAR, PRODUCT = CASES
_NOTCH = BenchmarkSystem(
    name="notch",
    equation={"y(k-1)": 1.2, "y(k-2)": -0.5, "u(k-1)": 1.0, "u(k-2)": -0.72, "u(k-3)": 1.0},
    draw_input=lambda rng, n: rng.uniform(-1, 1, n),
    noise_std=0.3,
    source="made for this page: its zeros lie on the unit circle at 1.2 rad a sample",
)
NOTCH = _case("notch", _NOTCH, 0.3, 300, (1,))
SHORT = _case("S6, from a short record", SYSTEMS["S6"], 0.05, 200, (1, 2, 3))
"""Here the law fails: near zero gain, and with parameters that are hardly known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """All that was done with the benchmark systems."""

    cases: Mapping[str, tuple[Spread, ...]]
    fragile: Mapping[str, tuple[Spread, ...]]
    coverage: Mapping[str, Mapping[int, Flags]]  # By case and order, shape (n_sets, n_frequencies)
    sweeps: tuple[Sweep, ...]
    spectra: tuple[Spread, ...]  # Orders of the output of `BILINEAR`
    surface: FrequencyResponse  # H_2 of `BILINEAR` over both frequencies
    speeds: tuple[Speed, ...]


def spreads(case: Case, seed: tuple[int, ...]) -> tuple[Spread, ...]:
    """Identify a case once; propagate to each order and draw."""
    rng = np.random.default_rng(seed)
    model = case.identify(rng)
    return tuple(
        spread_of(case.name, model, case.response(order), rng, case.response(order, CURVE)(model).values)
        for order in case.orders
    )


def covered(case: Case, seed: tuple[int, ...], n_sets: int = DATA_SETS) -> dict[int, Flags]:
    """Identify a case from many recordings; test whether regions hold the truth, (n_sets, n_frequencies)."""
    rng = np.random.default_rng(seed)
    truth = {order: case.response(order)(case.system.model).values for order in case.orders}
    models = (case.identify(rng) for _ in range(n_sets))
    held = [[propagate(m, case.response(order)).contains(values) for order, values in truth.items()] for m in models]
    return dict(zip(case.orders, (np.array(flags) for flags in zip(*held, strict=True)), strict=True))


def spectra(case: Case, seed: tuple[int, ...]) -> tuple[Spread, ...]:
    """Propagate to the orders of the output of a multisine, and draw."""
    rng = np.random.default_rng(seed)
    model = case.identify(rng)
    phases = rng.uniform(0, 2 * np.pi, len(HARMONICS))
    angle = 2 * np.pi * np.arange(PERIOD) / PERIOD
    excitation = AMPLITUDE * sum(np.cos(n * angle + phase) for n, phase in zip(HARMONICS, phases, strict=True))
    lines = [partial(inner_lines, excitation=excitation, order=order, operating_input=AT) for order in (1, 2, 3)]
    return tuple(spread_of(case.name, model, quantity, rng) for quantity in lines)


def surface(case: Case, seed: tuple[int, ...]) -> FrequencyResponse:
    """H_2 of a case, identified once, over both frequencies."""
    model = case.identify(np.random.default_rng(seed))
    axis = np.pi / case.system.sample_time * np.linspace(-1, 1, SURFACE)
    return gfrf(model, 2, frequency_grid(axis, axis), operating_input=AT)


def sweep(case: Case, order: int, seed: tuple[int, ...]) -> Sweep:
    """Propagate and draw with the parameters known better and worse than they are."""
    rng = np.random.default_rng(seed)
    return sweep_of(case.short_name, case.identify(rng), case.response(order), rng, SCALES)


def speed(case: Case, order: int, seed: tuple[int, ...]) -> Speed:
    """Measure what propagation costs and how accurate it is."""
    rng = np.random.default_rng(seed)
    return speed_of(case.short_name, case.identify(rng), case.response(order), rng)
