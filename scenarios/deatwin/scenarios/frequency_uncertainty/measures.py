"""The stated measures: what is demanded of propagation and comparison, what they reach."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.ident.frequency.uncertainty.beside_draws import Spread
from deatwin.ident.narx.fleet.records import DRIFTING
from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.known import Known
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.studies.report.panels import SUBSCRIPTS
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Span, Words

WORDS = Words(__package__)
COVERED = (0.92, 0.98)
"""Share of the 95 % regions that may hold the truth."""
FASTER = 200.0
FALSE = 0.05
"""Share of the tests that may find something where there is nothing."""
CHANCE = (0.41, 1.60)
"""Between these a standard deviation of six lies with 95 %, over that of the law they are drawn from (chi-squared of
five degrees of freedom)."""


def judge(study: Study) -> list[Measure]:
    """Hold the study against what is demanded."""
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
    yield WORDS.measure("warned", numbers["missed"] == 0, **numbers)

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
    """Sizes of differences against what is true of the simulated fleet."""
    inside = [contrast.inside for contrast in fleet.contrasts]
    share = float(np.mean(inside))
    yield WORDS.measure("truth", share >= 0.9, percent=100 * share, total=len(inside))
    ratios = fleet.spread("steady") / fleet.predicted
    passed = bool(np.all((ratios >= CHANCE[0]) & (ratios <= CHANCE[1])))
    yield WORDS.measure("tolerances", passed, CHANCE=CHANCE, ratios=Span(ratios))
