"""The recordings of the fleet and of actuators that differ in a known way, and what is said of their responses."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import Comparison, Propagated, UncertaintyWarning, compare_records, gfrf, propagate
from deatwin.ident.frequency.comparison.bands import band_means
from deatwin.ident.frequency.comparison.fleet import Contrast, Means, contrast, spread_of_means
from deatwin.ident.narx import Term, generate_terms
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT, fit
from deatwin.ident.narx.fleet.records import STEADY, as_variant, at_tolerance, thinned
from deatwin.ident.narx.rules import AtMost
from deatwin.plant import Actuator, Plant, Recording, fleet, specification
from deatwin.plant.fleet import DURATION, HISTORIES, TOLERANCES

Array = NDArray[np.float64]

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
POINTS = 50  # Frequencies of a response that is drawn


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
    sums = 2 * np.pi * np.linspace(0.01, INPUT_BAND[1], POINTS)
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
