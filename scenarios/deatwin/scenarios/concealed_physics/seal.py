"""The seal: hashes of labels, thresholds and code, written before the first case is run; and the cases under it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from deatwin.plant.records import Json
from deatwin.studies.sweep.constants import constants
from deatwin.studies.sweep.seal import Sealed, digest, sources_digest
from deatwin.studies.sweep.store import CaseStore, read_seal

SCHEMA = "deatwin/concealed-seal/1"
CASE_SCHEMA = "deatwin/concealed-case/1"
DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")
"""Packages whose numbers decide a verdict."""
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

    def __init__(self, folder: Path | str, seal: Seal) -> None:
        super().__init__(folder, seal)

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case, numbers that are not finite as None; one that is there already stays."""
        super().put(name, _finite(dict(result)))

    @classmethod
    def opened(cls, folder: Path | str) -> Self:
        """Open a folder under the seal that it has."""
        return cls(folder, read_seal(Seal, folder))


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
