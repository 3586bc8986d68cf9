"""The stated measures: what is demanded of propagation and comparison, what they reach."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.ident.frequency.uncertainty.beside_draws import Spread
from deatwin.scenarios.frequency_uncertainty.benchmarks import Benchmarks
from deatwin.scenarios.frequency_uncertainty.consistency import Consistency
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.studies.report.story import Row

Array = NDArray[np.float64]

COVERED = (0.92, 0.98)
"""Share of the 95 % regions that may hold the truth."""
FASTER = 200.0
FALSE = 0.05
"""Share of the tests that may find something where there is nothing."""
DRIFTING = ("DEA 1", "DEA 2", "DEA 3", "DEA 4", "DEA 5")
"""Those whose histories go on while they are compared."""
CHANCE = (0.41, 1.60)
"""Between these a standard deviation of six lies with 95 %, over that of the law they are drawn from (chi-squared of
five degrees of freedom)."""


def judge(study: Study) -> list[Row]:
    """Hold the study against what is demanded."""
    benchmarks, fleet = study.benchmarks, study.consistency
    responses = [spread for each in benchmarks.cases.values() for spread in each]
    return [
        _monte_carlo("H₁, H₂, H₃ of four systems", responses),
        _monte_carlo("Y₁, Y₂, Y₃ of a multisine", benchmarks.spectra),
        *_coverage(benchmarks),
        _warned(benchmarks),
        _speed(benchmarks),
        *_null(fleet.tables["repeats"]),
        _no_drift(fleet.tables["steady"]),
        _drift(fleet.tables["fleet"]),
        _shared(fleet.tables["shared"]),
        _truth(fleet),
        _tolerances(fleet),
    ]


def _monte_carlo(what: str, spreads: Iterable[Spread]) -> Row:
    every = list(spreads)
    worst = max(every, key=lambda one: one.largest / one.allowed)
    out = [one for one in every if one.largest > one.allowed]
    strict = np.concatenate([one.strict for one in every])
    return Row(
        measure=f"{what}: propagated covariance of real and imaginary part against {len(every[0].sampled.draws):,} "
        f"draws, at the {strict.sum()} of {strict.size} frequencies where the nonlinearity is at most 0.1",
        demanded="all elements at all frequencies within a simultaneous 99 % Monte Carlo band, for each response",
        reached=f"{len(every) - len(out)} of {len(every)} responses; the worst departs by {worst.largest:.2f} standard "
        f"errors of {worst.allowed:.2f} allowed ({worst.symbol} of {worst.case})",
        passed=not out,
    )


def _coverage(benchmarks: Benchmarks) -> list[Row]:
    rows = []
    for name in benchmarks.cases:
        of = {order: flags for (case, order), flags in benchmarks.coverage.items() if case == name}
        shares = {order: float(flags.mean()) for order, flags in of.items()}
        sets = len(next(iter(of.values())))
        rows.append(
            Row(
                measure=f"{name}: true response in the 95 % region, mean over frequency, {sets} identified data sets",
                demanded="92 to 98 %",
                reached=", ".join(f"H{'₁₂₃'[order - 1]} {100 * share:.1f} %" for order, share in shares.items()),
                passed=all(COVERED[0] <= share <= COVERED[1] for share in shares.values()),
            )
        )
    return rows


def _warned(benchmarks: Benchmarks) -> Row:
    held = np.concatenate([sweep.held for sweep in benchmarks.sweeps])
    holds = np.concatenate([sweep.holds for sweep in benchmarks.sweeps])
    wrong = (held < COVERED[0]) | (held > COVERED[1])
    missed = int(np.sum(wrong & holds))
    return Row(
        measure="responses whose 95 % region holds less than 92 or more than 98 % of the draws at some frequency, the "
        "parameters known better and worse",
        demanded="propagation warns of each, with its nonlinearity",
        reached=f"of {held.size} it warns of {int(np.sum(~holds))}; {int(wrong.sum())} are so, {missed} of them "
        "without a warning",
        passed=missed == 0,
    )


def _speed(benchmarks: Benchmarks) -> Row:
    ratios = {one.label: one.ratio for one in benchmarks.speeds}
    return Row(
        measure="processor time of draws of equal accuracy, all computed at once, over that of propagation",
        demanded=f"at least {FASTER:g}",
        reached=", ".join(f"{name} {ratio:.0f}" for name, ratio in ratios.items()),
        passed=min(ratios.values()) >= FASTER,
    )


def _null(table: Comparison) -> list[Row]:
    single = float(np.mean([d.p_value < table.level for d in table.differences]))
    records = len({name for pair in table.pairs for name in pair})
    counted = f"{len(table.differences):,} tests of {len(table.pairs)} pairs of {records} records"
    return [
        Row(
            measure=f"repeats of one stationary actuator, {counted}: single tests that find a difference at 5 %",
            demanded="at most 5 %",
            reached=f"{100 * single:.1f} %",
            passed=single <= FALSE,
        ),
        Row(
            measure="the same, corrected for their number (Holm), as in the table of the fleet",
            demanded="at most 5 %; none with a probability of 95 %",
            reached=f"{len(table.significant)} tests",
            passed=table.share <= FALSE,
        ),
    ]


def _no_drift(table: Comparison) -> Row:
    found = [drift for drift in table.drifts if drift.drifts]
    return Row(
        measure="drifts within the records of the six without their histories (Holm)",
        demanded="none",
        reached=f"{len(found)} of {len(table.drifts)} tests",
        passed=not found,
    )


def _drift(table: Comparison) -> Row:
    found = sorted({drift.name for drift in table.drifts if drift.drifts})
    return Row(
        measure="actuators in whose record, as it is, drift is found (Holm)",
        demanded=f"{', '.join(DRIFTING)}, whose histories go on, and not DEA 6, whose is over",
        reached=", ".join(found) or "none",
        passed=found == list(DRIFTING),
    )


def _shared(table: Comparison) -> Row:
    different, drift = (
        int(sum(d.agreement is kind for d in table.differences)) for kind in (Agreement.DIFFERENT, Agreement.DRIFT)
    )
    total = len(table.differences)
    return Row(
        measure="one fabrication with each of the five histories that go on: tests that find a difference which drift "
        "does not explain",
        demanded="at most 5 %: these actuators share all parameters",
        reached=f"{different} of {total} ({100 * different / total:.0f} %); {drift} more are put down to drift",
        passed=different <= FALSE * total,
    )


def _truth(fleet: Consistency) -> Row:
    inside = [contrast.inside for contrast in fleet.contrasts]
    return Row(
        measure="true difference of a pair in the 95 % region of the measured one, six without histories",
        demanded="at least 90 % of all pairs, orders and bands",
        reached=f"{100 * np.mean(inside):.0f} % of {len(inside)}",
        passed=float(np.mean(inside)) >= 0.9,
    )


def _tolerances(fleet: Consistency) -> Row:
    ratios: Array = fleet.spread("steady") / fleet.predicted
    return Row(
        measure="standard deviation of the six without histories over the one that the tolerances of fabrication "
        "predict, by order and band",
        demanded=f"{CHANCE[0]:g} to {CHANCE[1]:g} in each: what chance makes of six",
        reached=f"{ratios.min():.2f} to {ratios.max():.2f}",
        passed=bool(np.all((ratios >= CHANCE[0]) & (ratios <= CHANCE[1]))),
    )
