"""Run the story: tracking, models, concealed effects, and designs on rigs that no check has seen."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant import Diaphragm, Plant, specification
from deatwin.plant.words import spaced
from deatwin.scenarios.control_check.concealed import EFFECTS, Concealed, conceal
from deatwin.scenarios.control_check.matters import Matters, compare_models
from deatwin.scenarios.control_check.tracking import EXCITED, FleetRun, Tracking, fleet_runs, track
from deatwin.scenarios.control_check.trials import Outcome, Trials, name_of, try_one
from deatwin.studies.parallel import between
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.voice import Progress

SIZES = {"short": 8, "standard": 100, "full": 400}  # Number of trials; the rest of the story is the same


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Everything that was found."""

    tracking: tuple[Tracking, ...]
    fleet: tuple[FleetRun, ...]  # The scheduled design on the six actuators
    matters: Matters  # Five models of one actuator
    concealed: tuple[Concealed, ...]  # One effect each
    outcomes: tuple[Outcome, ...]  # The trials


def carry_out(folder: Path, size: str, seed: int, jobs: int, tell: Progress) -> Study:
    """Run the story; finished trials in the folder are not repeated."""
    count = SIZES[size]
    rest = 15.0 / (15.0 + count)  # the rest of the story takes about as long as fifteen trials
    streams = np.random.SeedSequence(seed).spawn(3 + len(EFFECTS))
    rngs = [np.random.default_rng(stream) for stream in streams]
    tell(0.0, "tracking on the nominal rig")
    tracking = (
        track("nominal rig", Plant(rig=Diaphragm()), rngs[0]),
        track("specification", specification(), rngs[0], EXCITED),
    )
    tell(0.15 * rest, "the scheduled design on six actuators")
    six = fleet_runs(seed, rngs[1])
    tell(0.3 * rest, "five models of one actuator")
    matters = compare_models(rngs[2])
    found = []
    for number, effect in enumerate(EFFECTS):
        tell((0.4 + 0.6 * number / len(EFFECTS)) * rest, f"concealing {spaced(effect)}")
        found.append(conceal(effect, rngs[3 + number], jobs=jobs, seed=seed))
    outcomes = _trials(folder, count, seed, jobs, between(tell, rest, 1.0))
    return Study(tracking=tracking, fleet=six, matters=matters, concealed=tuple(found), outcomes=outcomes)


def _trials(folder: Path, count: int, seed: int, jobs: int, tell: Progress) -> tuple[Outcome, ...]:
    trials = Trials(folder, seed)
    trials.outcomes(number for number in range(count) if trials.has(name_of(number)))  # a bad one is told of at once
    cases = {name_of(number): number for number in range(count)}
    run_sweep(partial(_try, seed), cases, trials, jobs=jobs, tell=tell, noun="trial")
    return trials.outcomes(range(count))


def _try(seed: int, number: int) -> dict[str, Any]:
    return asdict(try_one(number, seed))
