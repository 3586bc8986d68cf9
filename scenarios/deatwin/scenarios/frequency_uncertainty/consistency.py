"""How far six actuators of one specification differ, in which order and band, and what of it is drift."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import gfrf
from deatwin.ident.frequency.comparison.bands import BandMean, band_means
from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.ident.frequency.comparison.equality import Scatter, equality
from deatwin.ident.frequency.comparison.records import compare_records
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyWarning, propagate
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.ident.narx.robust import robust
from deatwin.plant.recording import Recording
from deatwin.scenarios.frequency_uncertainty.actuators import BANDS, INPUT_BAND, OPERATING_INPUT, ORDERS, STRUCTURE

Array = NDArray[np.float64]
Means = tuple[BandMean, ...]

LEVEL = 0.05
"""Of all tests."""
SLOW = 4
"""Cosines over a record that count as its drift. The more there are, the faster a drift that is followed, and the less
is left to tell difference from drift: of two, four and eight, four are the fewest with which, on two fleets of other
seeds, at most 5 % of the tests called one fabrication different from itself (9 % with two, none with four)."""
POINTS = 50
"""Frequencies of a response that is drawn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contrast:
    """The difference of two actuators in one order and band, as measured and as it is."""

    measured: float
    true: float
    error: float  # Standard error of the measured one
    inside: bool  # Whether the true difference, a complex number, lies in the 95 % region of the measured one


@dataclass(frozen=True, kw_only=True, eq=False)
class Consistency:
    """All that is said of the fleet."""

    tables: Mapping[str, Comparison]
    means: Mapping[str, Mapping[str, Means]]
    shares: Mapping[str, Array]  # shape (n_columns,): What each tolerance alone would make, as a standard deviation
    responses: Mapping[str, tuple[Propagated, ...]]

    def spread(self, group: str) -> Array:
        """Standard deviation of the actuators of a group about their mean, without the scatter of the estimates.
        Shapes: returns (n_columns,).
        """
        six = list(self.means[group].values())
        found = []
        for column in range(len(six[0])):
            values = np.array([means[column].value for means in six])
            scatter = np.mean([_variance(means[column]) for means in six])
            variance = values.var(axis=0, ddof=1).sum() - scatter
            found.append(np.sqrt(max(0.0, variance)) / _gain(six, column))
        return np.array(found)

    @property
    def predicted(self) -> Array:
        """Spread that all tolerances together predict, shape (n_columns,), share of the gain."""
        total: Array = np.sqrt(np.sum(np.square(list(self.shares.values())), axis=0))
        return total

    @property
    def contrasts(self) -> tuple[Contrast, ...]:
        """Differences as measured beside differences as they are, without histories, pair by pair, by column."""
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


def identified(record: Recording) -> NarxModel:
    """Fit the structure, with the covariance that the record shows."""
    return robust(Fixed(terms=STRUCTURE).fit(record).model_, record)


def responses(record: Recording) -> tuple[Propagated, ...]:
    """H_1, H_2, H_3 of an actuator with their uncertainty, all tones equal."""
    model = identified(record)
    sums = 2 * np.pi * np.linspace(0.01, INPUT_BAND[1], POINTS)
    quantities = [
        partial(
            gfrf,
            order=n,
            omega=sums if n == 1 else np.repeat(sums[:, None] / n, n, axis=1),
            operating_input=OPERATING_INPUT,
        )
        for n in ORDERS
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)  # the page says it
        return tuple(propagate(model, quantity) for quantity in quantities)


def means_of(record: Recording) -> Means:
    """Responses of an actuator, averaged over bands."""
    return band_means(identified(record), ORDERS, BANDS, operating_input=OPERATING_INPUT, input_band=INPUT_BAND)


def shares_of(wished: Means, off: Mapping[str, Means]) -> dict[str, Array]:
    """Spread that each tolerance alone would make, all values within it being equally likely. Shapes: returns
    (n_columns,).
    """
    return {
        name: np.array(
            [
                np.linalg.norm(one.value - it.value) / (np.sqrt(3) * it.gain)
                for one, it in zip(made, wished, strict=True)
            ]
        )
        for name, made in off.items()
    }


def contrast(measured: tuple[BandMean, BandMean], true: tuple[BandMean, BandMean]) -> Contrast:
    """Hold a measured difference against the true one."""
    gain = float(np.hypot(true[0].gain, true[1].gain) / np.sqrt(2))
    away, apart = (pair[0].value - pair[1].value for pair in (measured, true))
    along = apart / max(float(np.linalg.norm(apart)), np.finfo(float).tiny)
    scale = sum(mean.scatter.scale for mean in measured)
    test = equality(away - apart, [mean.scatter for mean in measured])
    return Contrast(
        measured=float(along @ away) / gain,
        true=float(np.linalg.norm(apart)) / gain,
        error=float(np.sqrt(along @ scale @ along)) / gain,
        inside=test.p_value > 0.05,
    )


def share_of(table: Comparison, agreement: Agreement) -> Array:
    """Share of the pairs of a table that agree or differ in a way. Shapes: returns (n_columns,)."""
    flags = np.array([d.agreement is agreement for d in table.differences])
    return np.asarray(flags.reshape(len(table.pairs), len(table.columns)).mean(axis=0))


def _variance(mean: BandMean) -> float:
    scatter: Scatter = mean.scatter
    return float(np.trace(scatter.scale)) * scatter.dof / (scatter.dof - 2)


def _gain(six: list[Means], column: int) -> float:
    return float(np.sqrt(np.mean([means[column].gain ** 2 for means in six])))
