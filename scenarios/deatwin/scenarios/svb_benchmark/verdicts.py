"""The stated measures: what is demanded, what is reached."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from deatwin.scenarios.svb_benchmark.methods import METHODS
from deatwin.scenarios.svb_benchmark.oracle import Oracle, consult
from deatwin.scenarios.svb_benchmark.study import WHITE, Study
from deatwin.scenarios.svb_benchmark.trials import Rate
from deatwin.studies.report.story import Row

COVERAGE = (0.92, 0.98)
LEAST_PARAMETERS = 500
WEAK = "S6"
"""Its smallest term is so weak that no method can find it in all draws."""
CLEAN = "svb-clean"


def exact(study: Study, system: str, method: str) -> Rate:
    """Count the draws of which a method finds the true structure."""
    return Rate.of(trial.exact for trial in study.of(system, method))


def kept(study: Study, system: str, method: str) -> Rate:
    """Count the draws of which a method keeps every true term."""
    return Rate.of(trial.kept for trial in study.of(system, method))


def oracles(study: Study, system: str) -> tuple[Oracle, Oracle]:
    """Ask those who know the truth."""
    draws = study.contrasts[system]
    return consult([draw.full for draw in draws]), consult([draw.near for draw in draws])


def judge(study: Study) -> list[Row]:
    """Hold the study against what is demanded."""
    rows: list[Row] = []
    if "semp" in study.plan.methods:
        rows += _shares(study, "semp", "exact structure", ("S2", "S3", "S4"), 0.95)
        rows += _beside_oracles(study, "semp", "exact structure", 0.97)
    if CLEAN in study.plan.methods:
        strong = ("S1", "S2", "S3", "S4", "E1")
        rows += _shares(study, CLEAN, "every true term kept", strong, 1.0)
        rows += _beside_oracles(study, CLEAN, "every true term kept", 1.0)
        rows += _shares(study, CLEAN, "exact structure", strong, 0.9)
        rows += _beside_oracles(study, CLEAN, "exact structure", 0.95)
    rows += list(_coverage(study))
    rows += list(_sampler(study))
    return rows


def _rate(study: Study, system: str, method: str, what: str) -> Rate:
    return (exact if what.startswith("exact") else kept)(study, system, method)


def _shares(study: Study, method: str, what: str, systems: Iterable[str], least: float) -> Iterator[Row]:
    for system in systems:
        if system in study.plan.systems:
            rate = _rate(study, system, method, what)
            yield Row(
                measure=f"{METHODS[method].label}, {system}: {what}",
                demanded=f"at least {100 * least:g} %" if least < 1 else "in all draws",
                reached=str(rate),
                passed=rate.share >= least,
            )


def _beside_oracles(study: Study, method: str, what: str, share: float) -> Iterator[Row]:
    if WEAK not in study.plan.systems:
        return
    rate = _rate(study, WEAK, method, what)
    of = f"{share:g} of " if share < 1 else ""
    names = ("the oracle on all candidates", "the oracle from the true terms (stricter)")
    for name, oracle in zip(names, oracles(study, WEAK), strict=True):
        reference = oracle.exact if what.startswith("exact") else oracle.kept
        yield Row(
            measure=f"{METHODS[method].label}, {WEAK}: {what}, beside {name}",
            demanded=f"at least {of}{100 * reference.share:g} %",
            reached=str(rate),
            passed=rate.share >= share * reference.share,
        )


def _coverage(study: Study) -> Iterator[Row]:
    for estimator in sorted({estimator for _, estimator in study.covered}):
        sets = [study.covered[system, estimator] for system in WHITE if (system, estimator) in study.covered]
        if sets:
            rate = Rate.of(np.concatenate([flags.ravel() for flags in sets]).tolist())
            yield Row(
                measure=f"95 % intervals by {estimator}, given the right structure: {', '.join(WHITE)}",
                demanded=f"{_band()} of at least {LEAST_PARAMETERS} parameters are covered",
                reached=f"{rate} of {rate.count}",
                passed=_within(rate.share) and rate.count >= LEAST_PARAMETERS,
            )


def _sampler(study: Study) -> Iterator[Row]:
    if not study.comparisons:
        return
    same = Rate.of(draw.agrees for draw in study.comparisons)
    yield Row(
        measure="spike-and-slab sampler on S4: the terms it holds for more likely in than out",
        demanded="the same as those of SVB in every draw",
        reached=f"in {same.hits} of {same.count} draws",
        passed=same.hits == same.count,
    )
    for name, words in (("mass_given", "of the same structure"), ("mass", "averaged over structures")):
        mass = float(np.mean(np.concatenate([getattr(draw, name) for draw in study.comparisons])))
        yield Row(
            measure=f"its probability of SVB's 95 % intervals, {words}",
            demanded=_band(),
            reached=f"{100 * mass:.1f} %",
            passed=_within(mass),
        )


def _band() -> str:
    return f"{100 * COVERAGE[0]:g} to {100 * COVERAGE[1]:g} %"


def _within(share: float) -> bool:
    return COVERAGE[0] <= share <= COVERAGE[1]
