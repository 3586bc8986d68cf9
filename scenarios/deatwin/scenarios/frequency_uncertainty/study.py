"""All that is recorded, drawn and compared: systems whose equations are known, and the six actuators."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from operator import call
from typing import Any

import numpy as np

from deatwin.ident.frequency import (
    Comparison,
    FrequencyResponse,
    Propagated,
    UncertaintyWarning,
    compare_records,
    frequency_grid,
    gfrf,
    propagate,
)
from deatwin.ident.frequency.comparison.bands import band_means
from deatwin.ident.frequency.comparison.records import Contrast, Means, contrast, shares_of, spread_of_means
from deatwin.ident.frequency.spectrum import inner_lines
from deatwin.ident.frequency.uncertainty.beside_draws import Speed, Spread, Sweep, speed_of, spread_of, sweep_of
from deatwin.ident.frequency.uncertainty.regions import Quantity
from deatwin.ident.narx import Fixed, NarxModel, Term, generate_terms
from deatwin.ident.narx.fleet import OPERATING_INPUT, STEADY, as_variant, at_tolerance, fit, thinned
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem
from deatwin.ident.narx.terms import AtMost
from deatwin.plant import Actuator, Plant, Recording, fleet, specification
from deatwin.plant.arrays import Array, Booleans
from deatwin.plant.fleet import DURATION, HISTORIES, TOLERANCES
from deatwin.studies.parallel import between, run_told
from deatwin.studies.voice import Progress

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


CASES: Mapping[str, Case] = {
    case.name: case
    for case in (
        _case("S1, linear", SYSTEMS["S1"], 0.1, 500, (1,)),
        _case("S2, powers of the input", SYSTEMS["S2"], 0.01, 500, (1, 2, 3)),
        _case("S6, bilinear", SYSTEMS["S6"], 0.01, 4000, (1, 2, 3)),
        _case("E0, product of outputs", SYSTEMS["E0"], 0.1, 4000, (1, 2, 3)),
    )
}
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
    coverage: Mapping[str, Mapping[int, Booleans]]  # By case and order, shape (n_sets, n_frequencies)
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


def covered(case: Case, seed: tuple[int, ...], n_sets: int = DATA_SETS) -> dict[int, Booleans]:
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


FACTOR = 6  # Every so many samples are kept: 0.12 s, the sampling time of the story `semp-fleet`
STRUCTURE: tuple[Term, ...] = tuple(generate_terms(1, (0, 1), 3, rule=AtMost(output=1)))
"""All products up to the third degree of y(k-1), at most once, u(k) and u(k-1): chosen beforehand, so that no
covariance leaves out that terms were selected on the data."""
INPUT_BAND = (0.0, 1.0)  # Band of the thesis' noise, Hz
ORDERS = (1, 2, 3)
BANDS = ((0.0, 0.1), (0.1, 0.3), (0.3, 1.0))  # Bands of the output's frequencies, Hz
REPEATS = 24  # Records of one stationary actuator, each under noise of its own
BEGIN = 60.0
"""Begin of what is compared, s. Before it lie the transient from rest, what the story of the first actuator has from 10
to 30 s, and the shift of the sixth at 45 s."""
STATIONARY = 1  # Number of the actuator that is repeated, without its history
SHARED = (1, 2, 3, 4, 5)
"""Numbers of the histories that are given to one fabrication; the sixth is an event before what is compared."""
LEVEL = 0.05  # Level of all tests
SLOW = 4
"""Cosines over a record that count as its drift. The more there are, the faster a drift that is followed, and the less
is left to tell difference from drift: of two, four and eight, four are the fewest with which, on two fleets of other
seeds, at most 5 % of the tests called one fabrication different from itself (9 % with two, none with four)."""
DRAWN_POINTS = 50  # Frequencies of a response that is drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class Consistency:
    """Differences between six actuators of one specification by order and band, and the share caused by drift."""

    tables: Mapping[str, Comparison]  # By group of records
    means: Mapping[str, Mapping[str, Means]]  # By group and actuator
    shares: Mapping[str, Array]  # shape (n_columns,): standard deviation that each tolerance alone would make
    responses: Mapping[str, tuple[Propagated, ...]]  # H_1, H_2, H_3 of each actuator

    def spread(self, group: str) -> Array:
        """Standard deviation of the actuators of a group about their mean, share of the gain, shape (n_columns,)."""
        return spread_of_means(self.means[group].values())

    @property
    def predicted(self) -> Array:
        """Spread that all tolerances together predict, share of the gain, shape (n_columns,)."""
        return np.asarray(np.sqrt(np.sum(np.square(list(self.shares.values())), axis=0)))

    @property
    def contrasts(self) -> tuple[Contrast, ...]:
        """Measured and true differences of each pair of actuators without drift, by column."""
        steady, level = self.means["steady"], self.means["level"]
        return tuple(
            contrast((steady[one][column], steady[other][column]), (level[one][column], level[other][column]))
            for one, other in itertools.combinations(steady, 2)
            for column in range(len(self.columns))
        )

    @property
    def columns(self) -> tuple[tuple[int, float, float], ...]:
        """Order and band of each column, Hz."""
        return self.tables["fleet"].columns


def actuators(seed: int, n_repeats: int = REPEATS) -> dict[tuple[str, str], Actuator]:
    """The actuators to be recorded, by group and name."""
    six = fleet(seed)
    steady = {one.name: as_variant(one, STEADY) for one in six}
    still = steady[six[STATIONARY - 1].name]
    alike = (seed, 0)  # the fleet's own begin with seed and 1 to 6
    groups: dict[str, dict[str, Actuator]] = {
        "fleet": {one.name: one for one in six},
        "steady": steady,
        "level": {name: replace(one, seed=alike) for name, one in steady.items()},
        "repeats": {f"repeat {k}": replace(still, seed=(*still.seed, 1000 + k)) for k in range(1, n_repeats + 1)},
        "shared": {
            f"history {n}": _made(specification().with_effects(*HISTORIES[n - 1].effects), (seed, 0, 2000 + n))
            for n in SHARED
        },
        "tolerances": {name: _made(at_tolerance(name), alike) for name in TOLERANCES},
        "specification": {"": _made(specification(), alike)},
    }
    return {(group, name): one for group, each in groups.items() for name, one in each.items()}


def recorded(actuator: Actuator, duration: float = DURATION) -> Recording:
    """Record an actuator, thinned, from `BEGIN` on."""
    record = actuator.record(actuator.excitation(duration)).recordings[0]
    return thinned(record.section(round(BEGIN / record.sample_time), record.n_samples), FACTOR)


def compared(records: Mapping[str, Recording]) -> Comparison:
    """Compare all pairs of records."""
    return compare_records(
        records,
        STRUCTURE,
        ORDERS,
        BANDS,
        operating_input=OPERATING_INPUT,
        input_band=INPUT_BAND,
        level=LEVEL,
        n_slow=SLOW,
    )


def responses(record: Recording) -> tuple[Propagated, ...]:
    """H_1, H_2, H_3 of an actuator with their uncertainty, all tones equal."""
    model = fit(STRUCTURE, record)
    sums = 2 * np.pi * np.linspace(0.01, INPUT_BAND[1], DRAWN_POINTS)
    tones = {n: sums if n == 1 else np.repeat(sums[:, None] / n, n, axis=1) for n in ORDERS}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)  # the page says it
        return tuple(
            propagate(model, partial(gfrf, order=n, omega=omega, operating_input=OPERATING_INPUT))
            for n, omega in tones.items()
        )


def means_of(record: Recording) -> Means:
    """Responses of an actuator, averaged over bands."""
    model = fit(STRUCTURE, record)
    return band_means(model, ORDERS, BANDS, operating_input=OPERATING_INPUT, input_band=INPUT_BAND)


def _made(plant: Plant, seed: tuple[int, ...]) -> Actuator:
    return Actuator(name="made", plant=plant, story="", seed=seed)


Key = tuple[Any, ...]
Job = tuple[Callable[..., Any], *tuple[Any, ...]]

COMPARED = ("fleet", "steady", "shared", "repeats")
WEIGHED = ("fleet", "steady", "level", "tolerances")
TIMED = ((LINEAR, 1), (POWERS, 3), (BILINEAR, 2))
SWEPT = ((LINEAR, 1), (BILINEAR, 3), (PRODUCT, 2))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Size of the study."""

    repeats: int = REPEATS
    duration: float = DURATION
    data_sets: int = DATA_SETS


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All results of the study."""

    known: Known
    consistency: Consistency


def carry_out(seed: int, plan: Plan, *, jobs: int, progress: Progress) -> Study:
    """Record the actuators, draw parameters, and compare responses."""
    wanted = actuators(seed, plan.repeats)
    text = f"recording the fleet, its repeats and its tolerances, {len(wanted)} records"
    tasks = [(one, plan.duration) for one in wanted.values()]
    found = run_told(recorded, tasks, jobs, between(progress, 0.0, 0.5), text)
    work = _work(seed, plan, dict(zip(wanted, found, strict=True)))
    text = "propagating uncertainty, drawing samples, and comparing the actuators"
    results = run_told(call, work.values(), jobs, between(progress, 0.5, 0.95), text)
    done = dict(zip(work, results, strict=True))
    return Study(known=_known(done), consistency=_consistency(done))


def _work(seed: int, plan: Plan, records: dict[tuple[str, str], Recording]) -> dict[Key, Job]:
    """All that is done after the recordings, each under its own key; the longest first."""
    work: dict[Key, Job] = {("table", group): (compared, _group(records, group)) for group in reversed(COMPARED)}
    for number, (name, case) in enumerate(CASES.items()):
        work["covered", name] = covered, case, (seed, 1, number), plan.data_sets
        work["case", name] = spreads, case, (seed, 2, number)
    for number, case in enumerate((NOTCH, SHORT)):
        work["fragile", case.name] = spreads, case, (seed, 3, number)
    for number, (name, order) in enumerate(SWEPT):
        work["sweep", name] = sweep, CASES[name], order, (seed, 4, number)
    for number, (name, order) in enumerate(TIMED):
        work["speed", name] = speed, CASES[name], order, (seed, 6, number)
    work["spectra", ""] = spectra, CASES[BILINEAR], (seed, 5)
    work["surface", ""] = surface, CASES[BILINEAR], (seed, 5)
    work |= {("responses", name): (responses, record) for name, record in _group(records, "fleet").items()}
    weighed = (*WEIGHED, "specification")
    return work | {key: (means_of, record) for key, record in records.items() if key[0] in weighed}


def _known(done: dict[Key, Any]) -> Known:
    return Known(
        cases=_group(done, "case"),
        fragile=_group(done, "fragile"),
        coverage=_group(done, "covered"),
        sweeps=tuple(_group(done, "sweep").values()),
        spectra=done["spectra", ""],
        surface=done["surface", ""],
        speeds=tuple(_group(done, "speed").values()),
    )


def _consistency(done: dict[Key, Any]) -> Consistency:
    return Consistency(
        tables=_group(done, "table"),
        means={group: _group(done, group) for group in WEIGHED[:-1]},
        shares=shares_of(done["specification", ""], _group(done, "tolerances")),
        responses=_group(done, "responses"),
    )


def _group(done: dict[Any, Any], group: str) -> dict[str, Any]:
    return {name: value for (its, name), value in done.items() if its == group}
