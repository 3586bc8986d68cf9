"""All that is recorded, drawn and compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from deatwin.ident.frequency.comparison.fleet import shares_of
from deatwin.plant import Recording
from deatwin.plant.fleet import DURATION
from deatwin.scenarios.frequency_uncertainty import fleet, known
from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.known import CASES, Known
from deatwin.studies.parallel import between, call, run_told
from deatwin.studies.voice import Progress

Key = tuple[Any, ...]
Job = tuple[Callable[..., Any], *tuple[Any, ...]]

COMPARED = ("fleet", "steady", "shared", "repeats")
WEIGHED = ("fleet", "steady", "level", "tolerances")
TIMED = ((known.LINEAR, 1), (known.POWERS, 3), (known.BILINEAR, 2))
SWEPT = ((known.LINEAR, 1), (known.BILINEAR, 3), (known.PRODUCT, 2))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Size of the study."""

    repeats: int = fleet.REPEATS
    duration: float = DURATION
    data_sets: int = known.DATA_SETS


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All results of the study."""

    known: Known
    consistency: Consistency


def carry_out(seed: int, plan: Plan, *, jobs: int, progress: Progress) -> Study:
    """Record the actuators, draw parameters, and compare responses."""
    wanted = fleet.actuators(seed, plan.repeats)
    text = f"recording the fleet, its repeats and its tolerances, {len(wanted)} records"
    tasks = [(one, plan.duration) for one in wanted.values()]
    found = run_told(fleet.recorded, tasks, jobs, between(progress, 0.0, 0.5), text)
    work = _work(seed, plan, dict(zip(wanted, found, strict=True)))
    text = "propagating uncertainty, drawing samples, and comparing the actuators"
    results = run_told(call, work.values(), jobs, between(progress, 0.5, 0.95), text)
    done = dict(zip(work, results, strict=True))
    return Study(known=_known(done), consistency=_consistency(done))


def _work(seed: int, plan: Plan, records: dict[tuple[str, str], Recording]) -> dict[Key, Job]:
    """All that is done after the recordings, each under its own key; the longest first."""
    work: dict[Key, Job] = {("table", group): (fleet.compared, _group(records, group)) for group in reversed(COMPARED)}
    for number, (name, case) in enumerate(CASES.items()):
        work["covered", name] = known.covered, case, (seed, 1, number), plan.data_sets
        work["case", name] = known.spreads, case, (seed, 2, number)
    for number, case in enumerate((known.NOTCH, known.SHORT)):
        work["fragile", case.name] = known.spreads, case, (seed, 3, number)
    for number, (name, order) in enumerate(SWEPT):
        work["sweep", name] = known.sweep, CASES[name], order, (seed, 4, number)
    for number, (name, order) in enumerate(TIMED):
        work["speed", name] = known.speed, CASES[name], order, (seed, 6, number)
    work["spectra", ""] = known.spectra, CASES[known.BILINEAR], (seed, 5)
    work["surface", ""] = known.surface, CASES[known.BILINEAR], (seed, 5)
    work |= {("responses", name): (fleet.responses, record) for name, record in _group(records, "fleet").items()}
    weighed = (*WEIGHED, "specification")
    return work | {key: (fleet.means_of, record) for key, record in records.items() if key[0] in weighed}


def _known(done: dict[Key, Any]) -> Known:
    return Known(
        cases=_group(done, "case"),
        fragile=_group(done, "fragile"),
        coverage=_group(done, "covered"),
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


def _group(done: dict[Any, Any], group: str) -> dict[str, Any]:
    return {name: value for (its, name), value in done.items() if its == group}
