"""Run the study: hit rates, oracles, coverage, the noise sweep, and the sampler; a file for each case."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.arrays import Booleans
from deatwin.plant.records import plain, read
from deatwin.scenarios.svb_benchmark.draws import (
    ESTIMATORS,
    METHODS,
    VARIATIONAL,
    Comparison,
    Contrast,
    Trial,
    compare,
    contrast,
    covered,
    try_out,
)
from deatwin.studies.provenance import versions
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, sources_digest
from deatwin.studies.sweep.store import CaseStore

DRAWS = 100  # Draws of each system
LEVELS = (0.0005, 0.001, 0.002, 0.004, 0.008)  # Variances of e(k) in the sweep of E1; its own is the fourth
SWEPT = "E1"
WHITE = ("S1", "S2", "S3", "S4", "S6")  # Systems whose intervals must cover
COVERAGE = {name: tuple(ESTIMATORS)[:2] for name in (*WHITE, SWEPT)} | {"S5": tuple(ESTIMATORS)}
"""Estimators whose intervals are tried; those with a noise model where the noise is coloured."""
CASES = "draws"  # Folder of the cases
SCHEMA = "deatwin/hit-rate-case/1"
PACKAGES = ("deatwin.plant", "deatwin.ident")
OWN = ("draws.py", "study.py")  # Packages and modules whose code decides an answer
VERSIONS = ("deatwin", "numpy", "scipy", "scikit-learn")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Systems, methods and numbers of draws."""

    systems: tuple[str, ...] = tuple(SYSTEMS)
    methods: tuple[str, ...] = tuple(METHODS)
    draws: int = DRAWS
    swept_draws: int = DRAWS // 2
    sampled_draws: int = DRAWS // 10
    levels: tuple[float, ...] = LEVELS  # Variances of e(k) in the sweep

    @property
    def bayesian(self) -> tuple[str, ...]:
        """Methods with a posterior, for the noise sweep and the sampler; the last one is the best."""
        return tuple(name for name in self.methods if name.startswith("svb"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """The result of a case; what was not asked is absent."""

    trials: tuple[Trial, ...] = ()  # One for each method
    contrast: Contrast | None = None
    covered: Mapping[str, Booleans] = field(default_factory=dict)  # By estimator
    comparison: Comparison | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A question to one draw of a system, or to all of them."""

    name: str
    group: tuple[str, str]  # Question, and its subject
    effort: float  # Seconds, about
    answer: Callable[[int], Answer]  # Takes the seed


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """One noise level of the sweep."""

    variance: float
    trials: tuple[Trial, ...]
    covered: Booleans  # shape (draws, n_terms): Which 95 % intervals cover, given the right structure


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All trials and comparisons of the study."""

    plan: Plan
    trials: tuple[Trial, ...]  # Each method on each draw
    contrasts: Mapping[str, tuple[Contrast, ...]]  # By system
    covered: Mapping[tuple[str, str], Booleans]  # By system and estimator, each shape (draws, n_terms)
    levels: tuple[Level, ...]
    comparisons: tuple[Comparison, ...]

    def of(self, system: str, method: str) -> list[Trial]:
        """Return the trials of a method on a system."""
        return [trial for trial in self.trials if (trial.system, trial.method) == (system, method)]


class Draws(CaseStore):
    """The cases on the disk, all of one seed, one plan and one version of the code."""

    def __init__(self, folder: Path, seed: int, plan: Mapping[str, Any]) -> None:
        parts = {
            "seed": seed,
            "plan": dict(plan),
            "versions": versions(VERSIONS),
            "code": sources_digest(PACKAGES, [Path(__file__).parent / name for name in OWN]),
        }
        super().__init__(folder, SweepSeal(schema=SCHEMA, parts=parts), cases=CASES)

    def answer(self, name: str) -> Answer:
        """Read a case."""
        return self.read(name, partial(read, Answer))


def carry_out(folder: Path, seed: int, plan: Plan, *, jobs: int, tell: Callable[[float, str], None]) -> Study:
    """Run all cases that are not in the folder yet, and collect the results."""
    cases = {case.name: case for case in (*_tried(plan), *_covering(plan), *_noisy(plan), *_sampled(plan))}
    store = Draws(folder, seed, asdict(plan))
    for name in store.names() & set(cases):
        store.answer(name)  # a bad one is told of at once
    efforts = {name: case.effort for name, case in cases.items()}
    run_sweep(partial(_answered, seed), cases, store, jobs=jobs, tell=tell, efforts=efforts)
    found: dict[tuple[str, str], list[Answer]] = defaultdict(list)
    for name, case in cases.items():
        found[case.group].append(store.answer(name))
    return _study(plan, found)


def _answered(seed: int, case: Case) -> dict[str, Any]:
    return dict(plain(case.answer(seed)))


def _seconds(system: str, methods: Sequence[str]) -> float:
    return sum(METHODS[method].effort[_is_large(system)] for method in methods)


def _is_large(system: str) -> bool:
    return SYSTEMS[system].degree > 3


def _tried(plan: Plan) -> Iterator[Case]:
    """Ask every method, and the oracles, about each draw."""
    for system in plan.systems:
        for n in range(plan.draws):
            yield Case(
                name=f"{system}-{n:03d}",
                group=("tried", system),
                effort=_seconds(system, plan.methods) + (0.4 if _is_large(system) else 0.03),
                answer=partial(_try, system, plan.methods, n),
            )


def _try(system: str, methods: Sequence[str], number: int, seed: int) -> Answer:
    trials = tuple(try_out(system, method, seed, number) for method in methods)
    return Answer(trials=trials, contrast=contrast(system, seed, number))


def _covering(plan: Plan) -> Iterator[Case]:
    """Ask for the intervals of several estimators on all draws of a system."""
    for system, estimators in COVERAGE.items():
        effort = 0.003 * plan.draws * len(estimators)
        answer = partial(_cover, system, estimators, plan.draws)
        yield Case(name=f"{system}-coverage", group=("covering", system), effort=effort, answer=answer)


def _cover(system: str, estimators: Sequence[str], draws: int, seed: int) -> Answer:
    flags = {e: np.array([covered(system, e, seed, number) for number in range(draws)]) for e in estimators}
    return Answer(covered=flags)


def _noisy(plan: Plan) -> Iterator[Case]:
    """Ask some methods, and for the intervals of variational Bayes, on each draw of E1 with other noise."""
    for variance in plan.levels:
        for n in range(plan.swept_draws):
            yield Case(
                name=f"{SWEPT}-{variance:g}-{n:03d}",
                group=("noisy", f"{variance:g}"),
                effort=_seconds(SWEPT, plan.bayesian) + 0.003,
                answer=partial(_try_noisy, variance, plan.bayesian, n),
            )


def _try_noisy(variance: float, methods: Sequence[str], number: int, seed: int) -> Answer:
    flags = covered(SWEPT, VARIATIONAL, seed, number, variance)
    trials = tuple(try_out(SWEPT, method, seed, number, variance) for method in methods)
    return Answer(trials=trials, covered={VARIATIONAL: flags[None, :]})


def _sampled(plan: Plan) -> Iterator[Case]:
    """Ask the best method and the sampler of structures about some draws of S4."""
    for n in range(plan.sampled_draws):
        answer = partial(_sample, plan.bayesian[-1], n)
        yield Case(name=f"S4-sampler-{n:03d}", group=("sampled", "S4"), effort=2.0, answer=answer)


def _sample(method: str, number: int, seed: int) -> Answer:
    return Answer(comparison=compare("S4", method, seed, number))


def _study(plan: Plan, found: Mapping[tuple[str, str], Sequence[Answer]]) -> Study:
    tried = {system: found["tried", system] for system in plan.systems}
    return Study(
        plan=plan,
        trials=tuple(trial for answers in tried.values() for trial in _by_method(answers)),
        contrasts={s: tuple(a.contrast for a in answers if a.contrast is not None) for s, answers in tried.items()},
        covered={(s, e): flags for s in COVERAGE for e, flags in found["covering", s][0].covered.items()},
        levels=tuple(_level(variance, found["noisy", f"{variance:g}"]) for variance in plan.levels),
        comparisons=tuple(a.comparison for a in found["sampled", "S4"] if a.comparison is not None),
    )


def _level(variance: float, answers: Sequence[Answer]) -> Level:
    flags = np.concatenate([answer.covered[VARIATIONAL] for answer in answers])
    return Level(variance=variance, trials=tuple(_by_method(answers)), covered=flags)


def _by_method(answers: Sequence[Answer]) -> Iterator[Trial]:
    """Order trials by method: all of the first, then all of the second."""
    return chain.from_iterable(zip(*(answer.trials for answer in answers), strict=True))
