"""All that is recorded, drawn and compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from deatwin.ident.parallel import run_jobs
from deatwin.plant.fleet import DURATION
from deatwin.scenarios.frequency_uncertainty.actuators import REPEATS, Records, collected, recorded, tasks
from deatwin.scenarios.frequency_uncertainty.benchmarks import (
    DATA_SETS,
    Benchmarks,
    covered,
    spectra,
    spreads,
    surface,
    sweep,
)
from deatwin.scenarios.frequency_uncertainty.consistency import Consistency, compared, means_of, responses, shares_of
from deatwin.scenarios.frequency_uncertainty.speed import speed
from deatwin.scenarios.frequency_uncertainty.systems import BILINEAR, CASES, LINEAR, NOTCH, POWERS, PRODUCT, SHORT
from deatwin.studies.voice import Progress

Key = tuple[Any, ...]
Job = tuple[Callable[..., Any], *tuple[Any, ...]]

SHARES = (0.5, 0.95)
"""Of all work that are done when the recordings are, and when all is compared."""
COMPARED = ("fleet", "steady", "shared", "repeats")
WEIGHED = ("fleet", "steady", "level", "tolerances")
TIMED = ((LINEAR, 1), (POWERS, 3), (BILINEAR, 2))
SWEPT = ((LINEAR, 1), (BILINEAR, 3), (PRODUCT, 2))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is done."""

    repeats: int = REPEATS
    duration: float = DURATION
    data_sets: int = DATA_SETS  # From which each benchmark system is identified


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All of it."""

    benchmarks: Benchmarks  # What was done with systems whose equations are known
    consistency: Consistency  # What is said of the fleet


def carry_out(seed: int, plan: Plan, *, jobs: int, progress: Progress) -> Study:
    """Record, draw and compare."""
    wanted = tasks(seed, plan.repeats, plan.duration)
    text = f"recording the fleet, its repeats and its tolerances, {len(wanted)} records"
    recording = {key: (recorded, *arguments) for key, arguments in wanted.items()}
    records = collected(_all(recording, jobs, progress, 0.0, SHARES[0], text))
    work = _work(seed, plan, records)
    done = _all(work, jobs, progress, *SHARES, "propagating beside draws, and comparing the actuators")
    return Study(benchmarks=_benchmarks(done), consistency=_consistency(done))


def _work(seed: int, plan: Plan, records: Records) -> dict[Key, Job]:
    """All that is done after the recordings, each under its own key; the longest first."""
    work: dict[Key, Job] = {("table", group): (compared, getattr(records, group)) for group in reversed(COMPARED)}
    for number, (name, case) in enumerate(CASES.items()):
        work["covered", name] = covered, case, (seed, 1, number), plan.data_sets
        work["case", name] = spreads, case, (seed, 2, number)
    for number, case in enumerate((NOTCH, SHORT)):
        work["fragile", case.name] = spreads, case, (seed, 3, number)
    for number, (name, order) in enumerate(SWEPT):
        work["sweep", name] = sweep, CASES[name], order, (seed, 4, number)
    for number, (name, order) in enumerate(TIMED):
        work["speed", name] = speed, CASES[name], order, (seed, 6, number)
    work["spectra", ""] = spectra, CASES[BILINEAR], (seed, 5)
    work["surface", ""] = surface, CASES[BILINEAR], (seed, 5)
    work |= {("responses", name): (responses, record) for name, record in records.fleet.items()}
    for group in WEIGHED:
        work |= {(group, name): (means_of, record) for name, record in getattr(records, group).items()}
    work["specification", ""] = means_of, records.specification
    return work


def _benchmarks(done: dict[Key, Any]) -> Benchmarks:
    return Benchmarks(
        cases=_group(done, "case"),
        fragile=_group(done, "fragile"),
        coverage={(name, order): f for name, by in _group(done, "covered").items() for order, f in by.items()},
        sweeps=tuple(_group(done, "sweep").values()),
        spectra=done["spectra", ""],
        surface=done["surface", ""],
        speeds=tuple(_group(done, "speed").values()),
    )


def _consistency(done: dict[Key, Any]) -> Consistency:
    return Consistency(
        tables=_group(done, "table"),
        means={group: _group(done, group) for group in WEIGHED[:-1]},
        shares=shares_of(done["specification", ""], _group(done, "tolerances")),
        responses=_group(done, "responses"),
    )


def _group(done: dict[Key, Any], group: str) -> dict[str, Any]:
    return {name: value for (its, name), value in done.items() if its == group}


def _all(work: dict[Key, Job], jobs: int, progress: Progress, first: float, last: float, doing: str) -> dict[Key, Any]:
    """Do all work, telling what share of everything it is."""

    def tell(n: int) -> None:
        progress(first + (last - first) * n / len(work), doing)

    tell(0)
    return dict(zip(work, run_jobs(_do, work.values(), workers=jobs, finished=tell), strict=True))


def _do(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)
