"""Run the study: sealed first, in parallel; it may be killed at any time and continues where it stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.interrupts import obeying
from deatwin.scenarios.concealed_physics.cases import IntervalSpec, case_specs, interval_specs, size_named
from deatwin.scenarios.concealed_physics.examine import examine
from deatwin.scenarios.concealed_physics.generator.specimens import CaseSpec
from deatwin.scenarios.concealed_physics.intervals import cover
from deatwin.scenarios.concealed_physics.key import key_dict
from deatwin.scenarios.concealed_physics.seal import Seal, Store
from deatwin.studies.sweep.run import run_sweep

EFFORT = {"clean": 0.5, "interval": 0.15, "tie": 2.0}
"""Work of a case of that kind; others take 1."""

Spec = CaseSpec | IntervalSpec


def labels(size: str, seed: int) -> tuple[Spec, ...]:
    """List all cases of a study with their concealed effects."""
    return (*case_specs(size, seed), *interval_specs(size, seed))


def key_of(specs: Sequence[Spec]) -> dict[str, Any]:
    """Make the key: the concealed effect of each case, and its right names."""
    return {"names": key_dict(), "cases": [spec.to_dict() for spec in specs]}


def carry_out(folder: Path, size: str, seed: int, jobs: int, tell: Callable[[float, str], None]) -> Store:
    """Seal the study, or continue it, and run every case that has no result."""
    tell(0.0, "sealing labels and thresholds")
    specs = labels(size, seed)
    store = Store(folder, Seal.of(size, seed, key_of(specs)))
    run_sweep(
        partial(run_case, size),
        {spec.name: spec for spec in _mixed(specs, seed)},
        store,
        jobs=jobs,
        tell=tell,
        efforts={spec.name: EFFORT.get(spec.kind, 1.0) for spec in specs},
    )
    return store


def run_case(size: str, spec: Spec) -> dict[str, Any]:
    """Run a case; an error is a result."""
    begun = time.process_time()
    of = size_named(size)
    try:
        with obeying():
            result = cover(spec) if isinstance(spec, IntervalSpec) else examine(spec, of.seconds, of.check_seconds)
    except Exception as error:  # whatever it is, the case is counted: it failed
        result = {"status": "error", "message": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    return {**result, "seconds_in_all": round(time.process_time() - begun, 2)}


def _mixed(specs: Sequence[Spec], seed: int) -> list[Spec]:
    """Mix all kinds: the time left is known early, and an interrupted study holds a fair sample."""
    return [specs[k] for k in np.random.default_rng(seed).permutation(len(specs))]
