"""The tables of the page: where the actuators differ, what the tolerances make, and what propagation costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyStatus
from deatwin.plant.fleet import TOLERANCES
from deatwin.scenarios.frequency_uncertainty.benchmarks import Benchmarks
from deatwin.scenarios.frequency_uncertainty.consistency import Consistency, share_of
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.scenarios.frequency_uncertainty.words import column_of
from deatwin.studies.report.story import Table

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
    return [
        _by_column(fleet),
        _pairs("Differences between the actuators as recorded", fleet.tables["fleet"]),
        _pairs("Differences between the actuators without their histories", fleet.tables["steady"]),
        _drifts(fleet.tables["fleet"]),
        _tolerances(fleet),
        _systems(study.benchmarks),
        _speeds(study.benchmarks),
    ]


def _by_column(fleet: Consistency) -> Table:
    of = {group: fleet.tables[group] for group in ("repeats", "steady", "fleet")}
    single = {g: _columnwise([d.p_value < t.level for d in t.differences], t) for g, t in of.items()}
    found = {(g, kind): share_of(t, kind) for g, t in of.items() for kind in Agreement}
    spreads = {group: fleet.spread(group) for group in ("steady", "fleet")}
    rows = [
        [
            column_of(column),
            f"{100 * single['repeats'][i]:.1f} %",
            _percent(1 - found["repeats", Agreement.ALIKE][i]),
            _percent(1 - found["steady", Agreement.ALIKE][i]),
            _percent(found["fleet", Agreement.DIFFERENT][i]),
            _percent(found["fleet", Agreement.DRIFT][i]),
            f"{100 * fleet.predicted[i]:.1f} %",
            f"{100 * spreads['steady'][i]:.1f} %",
            f"{100 * spreads['fleet'][i]:.1f} %",
        ]
        for i, column in enumerate(fleet.columns)
    ]
    return Table(
        title="How consistent fabrication is, by order and band",
        columns=[
            "order, output band",
            "null: repeats that differ, single tests at 5 %",
            "null: corrected",
            "pairs that differ, without histories",
            "pairs that differ beyond drift, as recorded",
            "pairs that differ, as drift explains",
            "spread that the tolerances predict",
            "spread without histories",
            "spread as recorded",
        ],
        rows=rows,
    )


def _pairs(title: str, table: Comparison) -> Table:
    width = len(table.columns)
    rows = []
    for number, pair in enumerate(table.pairs):
        cells = [
            f"{100 * d.size:.0f} %, {_MARKS[d.agreement]}, p {_p(d.adjusted)}"
            for d in table.differences[number * width : (number + 1) * width]
        ]
        rows.append([f"{pair[0]} and {pair[1]}", *cells])
    return Table(title=title, columns=["pair", *(column_of(c) for c in table.columns)], rows=rows)


def _drifts(table: Comparison) -> Table:
    names = list(dict.fromkeys(drift.name for drift in table.drifts))
    rows = []
    for name in names:
        of = [drift for drift in table.drifts if drift.name == name]
        rows.append([name, *(f"{100 * d.size:.0f} %, {'drifts' if d.drifts else '–'}, p {_p(d.adjusted)}" for d in of)])
    return Table(
        title="Drift within the records as they are: largest difference between two times",
        columns=["actuator", *(column_of(c) for c in table.columns)],
        rows=rows,
    )


def _tolerances(fleet: Consistency) -> Table:
    ordered = sorted(fleet.shares.items(), key=lambda item: -float(np.sum(item[1])))
    rows = []
    for name, values in ordered:
        words = name.replace("_", " ").replace(".", " ")
        rows.append([words, f"±{100 * TOLERANCES[name].share:g} %", *(f"{100 * value:.1f} %" for value in values)])
    rows.append(["all together", "", *(f"{100 * value:.1f} %" for value in fleet.predicted)])
    return Table(
        title="What each tolerance of fabrication makes of the responses: standard deviation, to first order",
        columns=["quantity", "tolerance", *(column_of(column) for column in fleet.columns)],
        rows=rows,
    )


def _systems(benchmarks: Benchmarks) -> Table:
    rows = []
    for spread in [s for group in (benchmarks.cases, benchmarks.fragile) for each in group.values() for s in each]:
        longest = np.sqrt(np.linalg.eigvalsh(spread.propagated.covariance)[:, -1]) / spread.propagated.gain
        rows.append(
            [
                spread.case,
                spread.symbol,
                f"{100 * longest.min():.2g} to {100 * longest.max():.2g} %",
                f"{spread.propagated.nonlinearity.max():.2g}",
                f"{np.sqrt(spread.ratio):.3g}",
                f"{100 * spread.held:.1f} %",
                _SAYS[spread.propagated.status],
            ]
        )
    return Table(
        title="Propagation beside draws",
        columns=[
            "system",
            "response",
            "standard deviation over gain",
            "largest nonlinearity",
            "deviation of the draws over that propagated, worst",
            "draws in the 95 % region, worst",
            "propagation says",
        ],
        rows=rows,
    )


def _speeds(benchmarks: Benchmarks) -> Table:
    rows = [
        [
            one.label,
            f"{1e3 * one.propagated:.1f} ms",
            f"{1e3 * one.drawn:.0f} ms",
            f"{one.alone:.0f} s",
            f"{100 * one.error:.1f} %",
            f"{100 * one.drawn_error:.1f} %",
            f"{one.equal:,.0f}",
            f"{one.ratio:.0f}",
        ]
        for one in benchmarks.speeds
    ]
    return Table(
        title="What propagation and draws cost, in processor time (it differs from run to run)",
        columns=[
            "response",
            "propagation, with its nonlinearity",
            "20,000 draws at once",
            "20,000 draws one by one",
            "largest error of propagation",
            "of 20,000 draws",
            "draws of equal accuracy",
            "their time over propagation's",
        ],
        rows=rows,
    )


def _columnwise(flags: Sequence[bool], table: Comparison) -> np.ndarray:
    return np.reshape(flags, (len(table.pairs), len(table.columns))).mean(axis=0)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _p(value: float) -> str:
    return "< 0.001" if value < 1e-3 else f"{value:.2g}"
