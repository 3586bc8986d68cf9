"""All that is computed: hit rates, oracles, coverage, the noise sweep, and the sampler."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.systems import SYSTEMS
from deatwin.ident.parallel import run_jobs
from deatwin.scenarios.svb_benchmark.coverage import ESTIMATORS, VARIATIONAL, covered
from deatwin.scenarios.svb_benchmark.methods import METHODS
from deatwin.scenarios.svb_benchmark.oracle import Contrast, contrast
from deatwin.scenarios.svb_benchmark.sampling import Comparison, compare
from deatwin.scenarios.svb_benchmark.trials import Trial, try_out

__all__ = ["DRAWS", "LEVELS", "SWEPT", "Level", "Plan", "Study", "carry_out"]

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
    """How much is done.

    Parameters
    ----------
    systems, methods : tuple of str
        By name.
    draws : int
        Of each system.
    swept_draws : int
        Of each noise level.
    sampled_draws : int
        Of S4, for the sampler.
    levels : tuple of float
        Variances of e(k) in the sweep.
    """

    systems: tuple[str, ...] = tuple(SYSTEMS)
    methods: tuple[str, ...] = tuple(METHODS)
    draws: int = DRAWS
    swept_draws: int = DRAWS // 2
    sampled_draws: int = DRAWS // 10
    levels: tuple[float, ...] = LEVELS

    @property
    def bayesian(self) -> tuple[str, ...]:
        """The methods with a posterior, which the sweep and the sampler look at; the last is the best of them."""
        return tuple(name for name in self.methods if name.startswith("svb"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """One noise level of the sweep.

    Parameters
    ----------
    variance : float
        Of e(k).
    trials : tuple of Trial
        Of the Bayesian methods.
    covered : ndarray of bool, shape (draws, n_terms)
        Which 95 % intervals cover, given the right structure.
    """

    variance: float
    trials: tuple[Trial, ...]
    covered: Flags


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """What came out.

    Parameters
    ----------
    plan : Plan
        What was done.
    trials : tuple of Trial
        Each method on each draw.
    contrasts : mapping of str to tuple of Contrast
        Of each system's draws.
    covered : mapping of (str, str) to ndarray of bool, shape (draws, n_terms)
        By system and estimator: which 95 % intervals cover, given the right structure.
    levels : tuple of Level
        The noise sweep.
    comparisons : tuple of Comparison
        With the sampler.
    """

    plan: Plan
    trials: tuple[Trial, ...]
    contrasts: Mapping[str, tuple[Contrast, ...]]
    covered: Mapping[tuple[str, str], Flags]
    levels: tuple[Level, ...]
    comparisons: tuple[Comparison, ...]

    def of(self, system: str, method: str) -> list[Trial]:
        """Return the trials of a method on a system.

        Parameters
        ----------
        system, method : str
            By name.

        Returns
        -------
        list of Trial
        """
        return [trial for trial in self.trials if (trial.system, trial.method) == (system, method)]


def carry_out(
    seed: int, plan: Plan, *, jobs: int, tell: Callable[[float, str], None], keep: Callable[[Sequence[Trial]], None]
) -> Study:
    """Do it all.

    Parameters
    ----------
    seed : int
        Of the study.
    plan : Plan
        What to do.
    jobs : int
        Worker processes; -1 takes all cores.
    tell : callable
        Takes the share that is done and what is being done.
    keep : callable
        Takes all trials of hit rates so far, each time a method is through with a system.

    Returns
    -------
    Study
    """
    runner = _Runner(seed, plan, jobs, tell)
    trials: list[Trial] = []
    for system, method in product(plan.systems, plan.methods):
        trials += runner.run(f"{system}, {METHODS[method].label}", try_out, system, method, draws=plan.draws)
        keep(trials)
    contrasts = {
        system: tuple(runner.run(f"{system}, oracle", contrast, system, draws=plan.draws)) for system in plan.systems
    }
    return Study(
        plan=plan,
        trials=tuple(trials),
        contrasts=contrasts,
        covered={
            (system, estimator): np.array(
                runner.run(f"{system}, coverage", covered, system, estimator, draws=plan.draws)
            )
            for system, estimators in COVERAGE.items()
            for estimator in estimators
        },
        levels=tuple(_level(runner, plan, variance) for variance in plan.levels),
        comparisons=tuple(
            runner.run("S4, sampler", compare, "S4", plan.bayesian[-1], draws=plan.sampled_draws)
        ),
    )


def _level(runner: _Runner, plan: Plan, variance: float) -> Level:
    trials: list[Trial] = []
    for method in plan.bayesian:
        text = f"{SWEPT} at {variance:g}, {METHODS[method].label}"
        trials += runner.run(text, try_out, SWEPT, method, draws=plan.swept_draws, last=(variance,))
    flags = runner.run(
        f"{SWEPT}, coverage", covered, SWEPT, VARIATIONAL, draws=plan.swept_draws, last=(variance,)
    )
    return Level(variance=variance, trials=tuple(trials), covered=np.array(flags))


class _Runner:
    """Runs a function on numbered draws, and tells how much of all is done."""

    def __init__(self, seed: int, plan: Plan, jobs: int, tell: Callable[[float, str], None]) -> None:
        self.seed, self.jobs, self.tell = seed, jobs, tell
        self.done = 0.0
        self.total = plan.draws * sum(_effort(try_out, *names) for names in product(plan.systems, plan.methods))
        self.total += plan.draws * sum(_effort(contrast, system) for system in plan.systems)
        self.total += plan.draws * sum(len(names) * _effort(covered, system) for system, names in COVERAGE.items())
        swept = sum(_effort(try_out, SWEPT, method) for method in plan.bayesian) + _effort(covered, SWEPT)
        self.total += len(plan.levels) * plan.swept_draws * swept
        self.total += plan.sampled_draws * _effort(compare, "S4")

    def run(
        self, text: str, function: Callable[..., Any], *names: str, draws: int, last: tuple[Any, ...] = ()
    ) -> list[Any]:
        """Call the function for each draw with names, seed, number and what comes last."""
        before, effort = self.done, _effort(function, *names)

        def finished(count: int) -> None:
            self.done = before + effort * count
            self.tell(min(self.done / self.total, 1.0), text)

        tasks = [(*names, self.seed, number, *last) for number in range(draws)]
        return run_jobs(function, tasks, workers=self.jobs, finished=finished)


def _effort(function: Callable[..., Any], system: str, method: str = "") -> float:
    """Return how many seconds a draw takes, about."""
    large = SYSTEMS[system].degree > 3
    if function is try_out:
        return METHODS[method].efforts[large]
    return {contrast: (0.03, 0.4)[large], covered: 0.003, compare: 2.0}[function]
