"""Benchmark systems: propagation beside draws, coverage, where the law fails, and what propagation costs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, output_orders
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.uncertainty.beside_draws import DRAWS, Spread, departure, spread_of, symbol_of
from deatwin.ident.frequency.uncertainty.parameters import Quantity
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.sampling import sample
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

POINTS, CURVE = 40, 800
"""Frequencies of a response, and of one that is drawn as a line."""
AT = 0.0
"""Operating input of all systems."""
LOWEST = 0.02
"""Lowest frequency, over half the sampling rate."""
DATA_SETS = 400
"""Recordings from which each system is identified, for the coverage."""
SCALES = tuple(2.0**power for power in range(-1, 6))
"""Deviations of the parameters, over those identified."""
SURFACE = 65
"""Frequencies of H_2 along each axis."""
PERIOD, HARMONICS, AMPLITUDE = 64, range(3, 9), 0.1
"""Samples of the multisine, its harmonics, and the amplitude of each."""
CHUNKS = 40
"""Sets of `DRAWS` draws each, against which the error of the law is measured."""
CALLS = 7
"""Calls of propagation, of which the shortest counts."""
LOOP = 100
"""Draws that are computed one by one."""


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

    def omega(self, order: int, points: int = POINTS) -> Array:
        """Frequencies of a response: all tones equal, their sum up to half the sampling rate. Shapes: returns (points,)
        or (points, order), rad/s.
        """
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
class Sweep:
    """Propagation beside draws, with the parameters known better and worse."""

    label: str
    scales: Array  # shape (n,): of the parameters' deviations
    ratios: Array  # shape (n,): the draws' variance over the propagated one, furthest from one
    held: Array  # shape (n,): share of the draws in the 95 % region, furthest from 95 %
    indices: Array  # shape (n,): the largest nonlinearity over the frequencies
    holds: Flags  # shape (n,): whether propagation says that its law holds at all frequencies


@dataclass(frozen=True, kw_only=True)
class Speed:
    """What propagation of one response costs, beside draws that say as much."""

    label: str
    propagated: float  # Processor time of propagation, of 20,000 draws all at once, and of as many one by one, s
    drawn: float
    alone: float
    error: float  # Largest relative error of propagation, and of 20,000 draws
    drawn_error: float
    equal: float  # Number of draws as accurate as propagation

    @property
    def ratio(self) -> float:
        """Time of draws of equal accuracy, computed all at once, over that of propagation."""
        return self.drawn * self.equal / DRAWS / self.propagated


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
    """Identify a case from many recordings, and test whether the regions hold the truth. Shapes: returns (n_sets,
    n_frequencies).
    """
    rng = np.random.default_rng(seed)
    truth = {order: case.response(order)(case.system.model).values for order in case.orders}
    models = (case.identify(rng) for _ in range(n_sets))
    held = [[propagate(m, case.response(order)).contains(values) for order, values in truth.items()] for m in models]
    return dict(zip(case.orders, (np.array(flags) for flags in zip(*held, strict=True)), strict=True))


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
    lines = [partial(_lines, excitation=excitation, order=order) for order in (1, 2, 3)]
    return tuple(spread_of(case.name, model, quantity, rng) for quantity in lines)


def surface(case: Case, seed: tuple[int, ...]) -> FrequencyResponse:
    """H_2 of a case, identified once, over both frequencies."""
    model = case.identify(np.random.default_rng(seed))
    axis = np.pi / case.system.sample_time * np.linspace(-1, 1, SURFACE)
    return gfrf(model, 2, frequency_grid(axis, axis), operating_input=AT)


def speed(case: Case, order: int, seed: tuple[int, ...]) -> Speed:
    """Measure what propagation costs and how accurate it is."""
    rng = np.random.default_rng(seed)
    model, quantity = case.identify(rng), case.response(order)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)
        propagated = propagate(model, quantity).covariance
        own = min(_timed(lambda: propagate(model, quantity).covariance) for _ in range(CALLS))
    begun = process_time()
    drawn = np.array([sample(model, quantity, rng, DRAWS).covariance for _ in range(CHUNKS)])
    together = (process_time() - begun) / CHUNKS
    pooled: Array = drawn.mean(axis=0)
    error = departure(pooled, propagated)
    drawn_error = float(np.mean([departure(pooled, one) for one in drawn]))
    floor = drawn_error / np.sqrt(CHUNKS)  # the departure of all draws together
    equal = DRAWS * (drawn_error / np.sqrt(max(error**2 - floor**2, floor**2))) ** 2
    thetas = rng.multivariate_normal(model.theta, model.theta_cov, LOOP)
    return Speed(
        label=f"{symbol_of(quantity(model))} of {case.name.split(',')[0]}",
        propagated=own,
        drawn=together,
        alone=_timed(lambda: [quantity(replace(model, theta=theta)) for theta in thetas]) / LOOP * DRAWS,
        error=error,
        drawn_error=drawn_error,
        equal=float(equal),
    )


def _timed(work: Callable[[], object]) -> float:
    begun = process_time()
    work()
    return process_time() - begun


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
