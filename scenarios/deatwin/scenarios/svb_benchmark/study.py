"""All that is computed: hit rates, oracles, coverage, the noise sweep, and the sampler."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.systems import SYSTEMS
from deatwin.scenarios.svb_benchmark.cases import Answer, Case, Covering, Noisy, Sampled, Tried
from deatwin.scenarios.svb_benchmark.coverage import ESTIMATORS, VARIATIONAL
from deatwin.scenarios.svb_benchmark.methods import METHODS
from deatwin.scenarios.svb_benchmark.oracle import Contrast
from deatwin.scenarios.svb_benchmark.record import Draws
from deatwin.scenarios.svb_benchmark.sampling import Comparison
from deatwin.scenarios.svb_benchmark.trials import Trial
from deatwin.studies.sweep.run import run_sweep

Flags = NDArray[np.bool_]

DRAWS = 100
"""Of each system."""
LEVELS = (0.0005, 0.001, 0.002, 0.004, 0.008)
"""Variances of e(k) in the sweep of E1; its own is the fourth."""
SWEPT = "E1"
WHITE = ("S1", "S2", "S3", "S4", "S6")
"""Systems whose intervals must cover."""
COVERAGE = {name: tuple(ESTIMATORS)[:2] for name in (*WHITE, SWEPT)} | {"S5": tuple(ESTIMATORS)}
"""Estimators whose intervals are looked at; those with a noise model where the noise is coloured."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is done."""

    systems: tuple[str, ...] = tuple(SYSTEMS)
    methods: tuple[str, ...] = tuple(METHODS)
    draws: int = DRAWS
    swept_draws: int = DRAWS // 2
    sampled_draws: int = DRAWS // 10
    levels: tuple[float, ...] = LEVELS  # Variances of e(k) in the sweep

    @property
    def bayesian(self) -> tuple[str, ...]:
        """The methods with a posterior, which the sweep and the sampler look at; the last is the best of them."""
        return tuple(name for name in self.methods if name.startswith("svb"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """One noise level of the sweep."""

    variance: float
    trials: tuple[Trial, ...]
    covered: Flags  # shape (draws, n_terms): Which 95 % intervals cover, given the right structure


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """What came out."""

    plan: Plan  # What was done
    trials: tuple[Trial, ...]  # Each method on each draw
    contrasts: Mapping[str, tuple[Contrast, ...]]
    covered: Mapping[tuple[str, str], Flags]
    levels: tuple[Level, ...]  # The noise sweep
    comparisons: tuple[Comparison, ...]  # With the sampler

    def of(self, system: str, method: str) -> list[Trial]:
        """Return the trials of a method on a system."""
        return [trial for trial in self.trials if (trial.system, trial.method) == (system, method)]


def carry_out(folder: Path, seed: int, plan: Plan, *, jobs: int, tell: Callable[[float, str], None]) -> Study:
    """Run every case that the folder does not hold yet, and put all together."""
    cases = {case.name: case for case in cases_of(plan)}
    store = Draws(folder, seed, asdict(plan))
    for name in store.names() & set(cases):
        store.answer(name)  # a bad one is told of at once
    efforts = {name: case.effort for name, case in cases.items()}
    run_sweep(partial(_answered, seed), cases, store, jobs=jobs, tell=tell, efforts=efforts)
    return _study(plan, {case: store.answer(name) for name, case in cases.items()})


def cases_of(plan: Plan) -> list[Case]:
    """All cases."""
    tried = (case for system in plan.systems for case in _tried(plan, system))
    noisy = (case for variance in plan.levels for case in _noisy(plan, variance))
    return [*tried, *_covering(plan), *noisy, *_sampled(plan)]


def _answered(seed: int, case: Case) -> dict[str, Any]:
    return case.answer(seed).to_dict()


def _tried(plan: Plan, system: str) -> list[Tried]:
    return [Tried(system=system, number=n, methods=plan.methods) for n in range(plan.draws)]


def _covering(plan: Plan) -> list[Covering]:
    return [Covering(system=name, draws=plan.draws, estimators=several) for name, several in COVERAGE.items()]


def _noisy(plan: Plan, variance: float) -> list[Noisy]:
    return [Noisy(system=SWEPT, variance=variance, number=n, methods=plan.bayesian) for n in range(plan.swept_draws)]


def _sampled(plan: Plan) -> list[Sampled]:
    return [Sampled(system="S4", number=n, method=plan.bayesian[-1]) for n in range(plan.sampled_draws)]


def _study(plan: Plan, found: Mapping[Case, Answer]) -> Study:
    tried = {system: [found[case] for case in _tried(plan, system)] for system in plan.systems}
    return Study(
        plan=plan,
        trials=tuple(trial for answers in tried.values() for trial in _by_method(answers)),
        contrasts={
            system: tuple(answer.contrast for answer in answers if answer.contrast is not None)
            for system, answers in tried.items()
        },
        covered={
            (case.system, estimator): flags
            for case in _covering(plan)
            for estimator, flags in found[case].covered.items()
        },
        levels=tuple(_level(variance, [found[case] for case in _noisy(plan, variance)]) for variance in plan.levels),
        comparisons=tuple(
            answer.comparison for answer in map(found.__getitem__, _sampled(plan)) if answer.comparison is not None
        ),
    )


def _level(variance: float, answers: Sequence[Answer]) -> Level:
    flags = np.concatenate([answer.covered[VARIATIONAL] for answer in answers])
    return Level(variance=variance, trials=tuple(_by_method(answers)), covered=flags)


def _by_method(answers: Sequence[Answer]) -> Iterator[Trial]:
    """All trials of the first method, then all of the second, and so on."""
    return chain.from_iterable(zip(*(answer.trials for answer in answers), strict=True))
