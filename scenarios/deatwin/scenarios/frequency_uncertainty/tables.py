"""The tables of the page: where the actuators differ, what the tolerances make, and what propagation costs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison, Difference
from deatwin.ident.frequency.comparison.fleet import share_of
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyStatus
from deatwin.plant.fleet import TOLERANCES
from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.known import Known
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.studies.report.panels import SUBSCRIPTS
from deatwin.studies.report.story import Table
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
_SAYS = {
    UncertaintyStatus.OK: "its law holds",
    UncertaintyStatus.LOW_GAIN: "a gain is near zero",
    UncertaintyStatus.BENT: "warns: too nonlinear",
    UncertaintyStatus.LOST: "warns: an equilibrium is lost",
    UncertaintyStatus.CERTAIN: "no covariance",
}
_MARKS = {Agreement.DIFFERENT: "differ", Agreement.DRIFT: "drift", Agreement.ALIKE: "–"}


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    fleet = study.consistency
    columns = [column_of(column) for column in fleet.columns]
    drifts = list(_drifts(fleet.tables["fleet"]))
    return [
        WORDS.table("consistency", list(_consistency(fleet))),
        WORDS.table("pairs", list(_pairs(fleet.tables["fleet"])), *columns, how="as recorded"),
        WORDS.table("pairs", list(_pairs(fleet.tables["steady"])), *columns, how="without their histories"),
        WORDS.table("drifts", drifts, *columns),
        WORDS.table("tolerances", list(_tolerances(fleet)), *columns),
        WORDS.table("systems", list(_systems(study.known))),
        WORDS.table("speeds", list(_speeds(study.known))),
    ]


def column_of(column: tuple[int, float, float], between: str = ", ") -> str:
    """An order and a band in words."""
    order, low, high = column
    return f"H{SUBSCRIPTS[order]}{between}{low:g}–{high:g} Hz"


def _consistency(fleet: Consistency) -> Iterator[list[str]]:
    repeats, steady, recorded = (fleet.tables[group] for group in ("repeats", "steady", "fleet"))
    single = np.reshape([d.p_value < repeats.level for d in repeats.differences], (len(repeats.pairs), -1)).mean(axis=0)
    shares = (
        1 - share_of(repeats, Agreement.ALIKE),
        1 - share_of(steady, Agreement.ALIKE),
        share_of(recorded, Agreement.DIFFERENT),
        share_of(recorded, Agreement.DRIFT),
    )
    spreads = (fleet.predicted, fleet.spread("steady"), fleet.spread("fleet"))
    for i, column in enumerate(fleet.columns):
        differ = [f"{100 * share[i]:.0f} %" for share in shares]
        sizes = [f"{100 * spread[i]:.1f} %" for spread in spreads]
        yield [column_of(column), f"{100 * single[i]:.1f} %", *differ, *sizes]


def _pairs(table: Comparison) -> Iterator[list[str]]:
    found: dict[tuple[str, str], list[Difference]] = {pair: [] for pair in table.pairs}
    for difference in table.differences:
        found[difference.first, difference.second].append(difference)
    for pair, each in found.items():
        yield [" and ".join(pair), *(f"{100 * d.size:.0f} %, {_MARKS[d.agreement]}, p {_p(d.adjusted)}" for d in each)]


def _drifts(table: Comparison) -> Iterator[list[str]]:
    for name in dict.fromkeys(drift.name for drift in table.drifts):
        each = [drift for drift in table.drifts if drift.name == name]
        yield [name, *(f"{100 * d.size:.0f} %, {'drifts' if d.drifts else '–'}, p {_p(d.adjusted)}" for d in each)]


def _tolerances(fleet: Consistency) -> Iterator[list[str]]:
    for name, values in sorted(fleet.shares.items(), key=lambda item: -float(np.sum(item[1]))):
        words = name.replace("_", " ").replace(".", " ")
        yield [words, f"±{100 * TOLERANCES[name].share:g} %", *(f"{100 * value:.1f} %" for value in values)]
    yield ["all together", "", *(f"{100 * value:.1f} %" for value in fleet.predicted)]


def _systems(known: Known) -> Iterator[list[str]]:
    for spread in [s for group in (known.cases, known.fragile) for each in group.values() for s in each]:
        longest = 100 * spread.relative
        yield [
            spread.case,
            spread.symbol,
            f"{longest.min():.2g} to {longest.max():.2g} %",
            f"{spread.propagated.nonlinearity.max():.2g}",
            f"{np.sqrt(spread.ratio):.3g}",
            f"{100 * spread.held:.1f} %",
            _SAYS[spread.propagated.status],
        ]


def _speeds(known: Known) -> Iterator[list[str]]:
    for one in known.speeds:
        yield [
            one.label,
            f"{1e3 * one.propagated:.1f} ms",
            f"{1e3 * one.drawn:.0f} ms",
            f"{one.alone:.0f} s",
            f"{100 * one.error:.1f} %",
            f"{100 * one.drawn_error:.1f} %",
            f"{one.equal:,.0f}",
            f"{one.ratio:.0f}",
        ]


def _p(value: float) -> str:
    return "< 0.001" if value < 1e-3 else f"{value:.2g}"
