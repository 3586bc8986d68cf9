"""Goals and tables: requirements on propagation and comparison, and the values reached."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from deatwin.ident.frequency import Agreement, Comparison, Difference, UncertaintyStatus
from deatwin.ident.frequency.comparison.fleet import share_of
from deatwin.ident.frequency.uncertainty.beside_draws import Spread
from deatwin.ident.narx.fleet.records import DRIFTING
from deatwin.plant.fleet import TOLERANCES
from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.known import Known
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.studies.report.drawing import SUBSCRIPTS
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Span, Words

WORDS = Words(__package__)
COVERED = (0.92, 0.98)  # Share of the 95 % regions that may hold the truth
FASTER = 200.0
FALSE = 0.05  # Share of the tests that may find something where there is nothing
CHANCE = (0.41, 1.60)
"""Between these a standard deviation of six lies with 95 %, over that of the law they are drawn from (chi-squared of
five degrees of freedom)."""


def judge(study: Study) -> list[Measure]:
    """Compare the study with its goals."""
    return [*_known(study.known), *_tests(study.consistency), *_sizes(study.consistency)]


def counted(table: Comparison, kind: Agreement) -> int:
    """Number of differences of a kind."""
    return sum(d.agreement is kind for d in table.differences)


def _known(known: Known) -> Iterable[Measure]:
    yield _draws("H₁, H₂, H₃ of four systems", [spread for each in known.cases.values() for spread in each])
    yield _draws("Y₁, Y₂, Y₃ of a multisine", list(known.spectra))
    for name, flags in known.coverage.items():
        shares = {order: float(each.mean()) for order, each in flags.items()}
        passed = all(COVERED[0] <= share <= COVERED[1] for share in shares.values())
        sets = len(next(iter(flags.values())))
        text = ", ".join(f"H{SUBSCRIPTS[order]} {100 * share:.1f} %" for order, share in shares.items())
        yield WORDS.measure("coverage", passed, name=name, sets=sets, shares=text)

    held, holds = (np.concatenate([getattr(one, name) for one in known.sweeps]) for name in ("held", "holds"))
    wrong = (held < COVERED[0]) | (held > COVERED[1])
    numbers = {"total": held.size, "warned": np.sum(~holds), "wrong": wrong.sum(), "missed": np.sum(wrong & holds)}
    yield WORDS.measure("warned", numbers["missed"] == 0, **{**numbers, "missed": numbers["missed"] or "none"})

    slowest = min(one.ratio for one in known.speeds)
    ratios = ", ".join(f"{one.label} {one.ratio:.0f}" for one in known.speeds)
    yield WORDS.measure("speed", slowest >= FASTER, FASTER=FASTER, ratios=ratios)


def _draws(what: str, every: list[Spread]) -> Measure:
    """Propagation against Monte Carlo."""
    strict = np.concatenate([one.strict for one in every])
    within = sum(one.largest <= one.allowed for one in every)
    return WORDS.measure(
        "draws",
        within == len(every),
        what=what,
        draws=len(every[0].sampled.draws),
        strict=strict.sum(),
        total=strict.size,
        within=within,
        responses=len(every),
        worst=max(every, key=lambda one: one.largest / one.allowed),
    )


def _tests(fleet: Consistency) -> Iterable[Measure]:
    """Tests of records that are known to differ or drift, and of records that do not."""
    repeats, steady, shared = (fleet.tables[group] for group in ("repeats", "steady", "shared"))
    single = float(np.mean([d.p_value < repeats.level for d in repeats.differences]))
    records = len({name for pair in repeats.pairs for name in pair})
    counts = {"tests": len(repeats.differences), "pairs": len(repeats.pairs), "records": records}
    yield WORDS.measure("single", single <= FALSE, single=100 * single, **counts)
    yield WORDS.measure("corrected", repeats.share <= FALSE, found=len(repeats.significant))

    drifts = sum(drift.drifts for drift in steady.drifts)
    yield WORDS.measure("no_drift", not drifts, found=drifts, total=len(steady.drifts))
    found = sorted({drift.name for drift in fleet.tables["fleet"].drifts if drift.drifts})
    names = {"DRIFTING": ", ".join(DRIFTING), "found": ", ".join(found) or "none"}
    yield WORDS.measure("drift", found == list(DRIFTING), **names)

    different, drift = (counted(shared, kind) for kind in (Agreement.DIFFERENT, Agreement.DRIFT))
    total = len(shared.differences)
    numbers = {"different": different, "total": total, "percent": 100 * different / total, "drift": drift}
    yield WORDS.measure("shared", different <= FALSE * total, **numbers)


def _sizes(fleet: Consistency) -> Iterable[Measure]:
    """Compare the sizes of differences with the true ones of the simulated fleet."""
    inside = [contrast.inside for contrast in fleet.contrasts]
    share = float(np.mean(inside))
    yield WORDS.measure("truth", share >= 0.9, percent=100 * share, total=len(inside))
    ratios = fleet.spread("steady") / fleet.predicted
    passed = bool(np.all((ratios >= CHANCE[0]) & (ratios <= CHANCE[1])))
    yield WORDS.measure("tolerances", passed, CHANCE=CHANCE, ratios=Span(ratios))


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


def _p(value: float) -> str:
    return "< 0.001" if value < 1e-3 else f"{value:.2g}"
