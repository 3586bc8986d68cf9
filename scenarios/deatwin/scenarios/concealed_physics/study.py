"""The sealed study, which may be killed and resumed: labels, thresholds and code are hashed before its first case."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.interrupts import obeying
from deatwin.plant.records import finite, plain
from deatwin.scenarios.concealed_physics.cases import SIZES, IntervalSpec, case_specs, interval_specs
from deatwin.scenarios.concealed_physics.examine import examine
from deatwin.scenarios.concealed_physics.generator.specimens import CaseSpec
from deatwin.scenarios.concealed_physics.intervals import cover
from deatwin.scenarios.concealed_physics.key import key_dict
from deatwin.studies.sweep.constants import thresholds
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest
from deatwin.studies.sweep.store import CaseStore

CASE_SCHEMA = "deatwin/concealed-case/1"
SEALED_CODE = ("deatwin.plant", "deatwin.ident")
STORY = Path(__file__).parent
OPEN_CODE = frozenset(STORY / name for name in ("__init__.py", "results.py", "score.py", "figures.py", "tables.py"))
"""Code that counts and draws: it is not sealed, so it may be mended when the cases are through."""


def seal_of(size: str, seed: int, key: Mapping[str, Any]) -> SweepSeal:
    """Seal labels, thresholds and the code that makes and runs the cases."""
    running = sorted({*STORY.rglob("*.py"), STORY / "key.toml"} - OPEN_CODE)
    parts = {
        "size": size,
        "seed": seed,
        "key": digest(key),
        "thresholds": thresholds(),
        "code": sources_digest(SEALED_CODE, running),
        "version": version("deatwin"),
    }
    return SweepSeal(schema=CASE_SCHEMA, parts=parts)


EFFORT = {"clean": 0.5, "interval": 0.15, "tie": 2.0}  # Work of a case of that kind; others take 1

Spec = CaseSpec | IntervalSpec


def labels(size: str, seed: int) -> tuple[Spec, ...]:
    """List all cases of a study with their concealed effects."""
    return (*case_specs(size, seed), *interval_specs(size, seed))


def key_of(specs: Sequence[Spec]) -> dict[str, Any]:
    """Make the key: the concealed effect of each case, and its right names."""
    return {"names": key_dict(), "cases": plain(specs)}


def carry_out(folder: Path, size: str, seed: int, jobs: int, tell: Callable[[float, str], None]) -> CaseStore:
    """Seal the study, or continue it, and run every case that has no result."""
    tell(0.0, "sealing labels and thresholds")
    specs = labels(size, seed)
    store = CaseStore(folder, seal_of(size, seed, key_of(specs)))
    # All kinds are mixed, so that an interrupted study holds a fair sample and the remaining time is known early.
    mixed = [specs[k] for k in np.random.default_rng(seed).permutation(len(specs))]
    run_sweep(
        partial(run_case, size),
        {spec.name: spec for spec in mixed},
        store,
        jobs=jobs,
        tell=tell,
        efforts={spec.name: EFFORT.get(spec.kind, 1.0) for spec in specs},
    )
    return store


def run_case(size: str, spec: Spec) -> dict[str, Any]:
    """Run a case; an exception becomes a result, and a non-finite number None."""
    begun = time.process_time()
    of = SIZES[size]
    try:
        with obeying():
            result = cover(spec) if isinstance(spec, IntervalSpec) else examine(spec, of.seconds, of.check_seconds)
    except Exception as error:  # whatever it is, the case is counted: it failed
        result = {"status": "error", "message": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    done: dict[str, Any] = finite({**result, "seconds_in_all": round(time.process_time() - begun, 2)})
    return done
