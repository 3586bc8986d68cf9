"""The sealed study, which may be killed and resumed: labels, thresholds and code are hashed before its first case."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np

from deatwin.plant.interrupts import obeying
from deatwin.plant.records import Json
from deatwin.scenarios.concealed_physics.cases import IntervalSpec, case_specs, interval_specs, size_named
from deatwin.scenarios.concealed_physics.examine import examine
from deatwin.scenarios.concealed_physics.generator.specimens import CaseSpec
from deatwin.scenarios.concealed_physics.intervals import cover
from deatwin.scenarios.concealed_physics.key import key_dict
from deatwin.studies.sweep import CaseStore, digest, run_sweep, sources_digest
from deatwin.studies.sweep.constants import constants
from deatwin.studies.sweep.seal import Sealed
from deatwin.studies.sweep.store import read_seal

SCHEMA = "deatwin/concealed-seal/1"
CASE_SCHEMA = "deatwin/concealed-case/1"
DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")  # Packages whose numbers decide a verdict
SEALED_CODE = ("deatwin.plant", "deatwin.ident")
STORY = Path(__file__).parent
OPEN_CODE = frozenset(STORY / name for name in ("__init__.py", "results.py", "score.py", "figures.py", "tables.py"))
"""Code that counts and draws. It has a hash of its own, and the report says whether it changed."""


@dataclass(frozen=True, kw_only=True)
class Seal(Sealed):
    """Hashes of everything that must not change between the first case and the last."""

    size: str
    seed: int
    key: str  # SHA-256 of all labels: the cases with what is concealed in each, and which names are right for it
    thresholds: Mapping[str, Json]  # Every number that decides, by module and name
    code: str  # SHA-256 of the sources of plant, identification, generator and runner
    scoring: str  # SHA-256 of the code that counts and draws, which may change
    version: str

    @classmethod
    def of(cls, size: str, seed: int, key: Mapping[str, Any]) -> Self:
        """Seal a study with the code as it is now."""
        running = sorted(set(STORY.rglob("*.py")) - OPEN_CODE)
        return cls(
            size=size,
            seed=seed,
            key=digest(key),
            thresholds=constants(DECIDING),
            code=sources_digest(SEALED_CODE, running),
            scoring=sources_digest((), sorted(OPEN_CODE)),
            version=version("deatwin"),
        )

    @property
    def content(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if name != "scoring"}

    @property
    def case_schema(self) -> str:
        return CASE_SCHEMA

    def described(self) -> dict[str, Any]:
        return {"schema": SCHEMA, **asdict(self)}

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Self:
        return cls(**{name: data[name] for name in cls.__dataclass_fields__})

    def changes(self, other: Self) -> str:
        """Name the parts that differ, and the first three of the thresholds."""
        mine, theirs = self.content, other.content
        changed = [name for name in mine if mine[name] != theirs[name]]
        if "thresholds" in changed:
            names = {*mine["thresholds"], *theirs["thresholds"]}
            moved = sorted(n for n in names if mine["thresholds"].get(n) != theirs["thresholds"].get(n))
            changed[changed.index("thresholds")] = f"thresholds ({', '.join(moved[:3])})"
        return f"{', '.join(changed)} changed since" if changed else ""


class Store(CaseStore[Seal]):
    """The cases of a sealed study."""

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case, with non-finite numbers as None; an existing result is kept."""
        super().put(name, _finite(dict(result)))

    @classmethod
    def opened(cls, folder: Path | str) -> Self:
        """Open a folder with its own seal."""
        return cls(folder, read_seal(Seal, folder))


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


EFFORT = {"clean": 0.5, "interval": 0.15, "tie": 2.0}  # Work of a case of that kind; others take 1

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
    """Run a case; an exception becomes a result."""
    begun = time.process_time()
    of = size_named(size)
    try:
        with obeying():
            result = cover(spec) if isinstance(spec, IntervalSpec) else examine(spec, of.seconds, of.check_seconds)
    except Exception as error:  # whatever it is, the case is counted: it failed
        result = {"status": "error", "message": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    return {**result, "seconds_in_all": round(time.process_time() - begun, 2)}


def _mixed(specs: Sequence[Spec], seed: int) -> list[Spec]:
    """Mix all kinds of cases, so that an interrupted study holds a fair sample and the remaining time is known early."""
    return [specs[k] for k in np.random.default_rng(seed).permutation(len(specs))]
