"""The seal: hashes of labels, thresholds and code, written before the first case is run."""

from __future__ import annotations

import hashlib
import pkgutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np

from deatwin.plant.records import Json
from deatwin.studies.sweep.seal import Sealed, digest

SCHEMA = "deatwin/concealed-seal/1"
CASE_SCHEMA = "deatwin/concealed-case/1"
DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")
"""Packages whose numbers decide a verdict."""
SEALED_CODE = ("deatwin.plant", "deatwin.ident", "deatwin.scenarios.concealed_physics")
OPEN_CODE = frozenset(
    {"__init__.py", "score.py", "opened.py", "rates.py", "confusion.py", "tables.py", "page.py", "figures.py"}
)
"""Of this folder: what counts and draws. It has a hash of its own, and the report says whether it changed."""


@dataclass(frozen=True, kw_only=True)
class Seal(Sealed):
    """What must not change between the first case and the last."""

    size: str
    seed: int
    key: str  # SHA-256 of all labels: the cases with what is concealed in each, and which names are right for it
    thresholds: Mapping[str, Json]  # Every number that decides, by module and name
    code: str  # SHA-256 of the sources of plant, identification, generator and runner
    scoring: str
    version: str

    @classmethod
    def of(cls, size: str, seed: int, key: Mapping[str, Any]) -> Self:
        """Seal a study with the code as it is now."""
        return cls(
            size=size,
            seed=seed,
            key=digest(key),
            thresholds=thresholds(),
            code=_sources(counting=False),
            scoring=_sources(counting=True),
            version=version("deatwin"),
        )

    @property
    def content(self) -> dict[str, Any]:
        """All but the sources that count and draw."""
        return {name: value for name, value in asdict(self).items() if name != "scoring"}

    @property
    def case_schema(self) -> str:
        """Of the files of the cases."""
        return CASE_SCHEMA

    def described(self) -> dict[str, Any]:
        """The content of ``seal.json`` without the hash."""
        return {"schema": SCHEMA, **asdict(self)}

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Self:
        """The seal that `described` described."""
        return cls(**{name: data[name] for name in cls.__dataclass_fields__})

    def changes(self, other: Self) -> str:
        """The parts that differ; of the thresholds the first three."""
        mine, theirs = self.content, other.content
        changed = [name for name in mine if mine[name] != theirs[name]]
        if "thresholds" in changed:
            names = {*mine["thresholds"], *theirs["thresholds"]}
            moved = sorted(n for n in names if mine["thresholds"].get(n) != theirs["thresholds"].get(n))
            changed[changed.index("thresholds")] = f"thresholds ({', '.join(moved[:3])})"
        return f"{', '.join(changed)} changed since" if changed else ""


def thresholds() -> dict[str, Any]:
    """Every module constant of the deciding packages that is a number or a group of numbers."""
    found = {}
    for package in map(import_module, DECIDING):
        modules = [package.__name__]
        modules += [m.name for m in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
        for module in modules:
            for name, value in vars(import_module(module)).items():
                plain = _numbers(value) if name.lstrip("_").isupper() else None
                if plain is not None:
                    found[f"{module}.{name}"] = plain
    return dict(sorted(found.items()))


def _numbers(value: Any) -> Any:
    """The value as plain data, where it is made of numbers; else None."""
    if isinstance(value, bool) or isinstance(value, (int, float)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        inside = {str(k): _numbers(v) for k, v in value.items()}
        return None if None in inside.values() or not inside else inside
    if isinstance(value, (tuple, list)):
        several = [_numbers(v) for v in value]
        return None if None in several or not several else several
    return None


def _sources(counting: bool) -> str:
    """SHA-256 of the sources that run a case, or of those that count afterwards."""
    parts = []
    for name in SEALED_CODE:
        for root in import_module(name).__path__:
            for path in sorted(p for p in Path(root).rglob("*") if p.is_file() and "__pycache__" not in p.parts):
                counts = name.endswith("concealed_physics") and path.parent == Path(root) and path.name in OPEN_CODE
                if counts == counting:
                    parts.append(f"{name}/{path.relative_to(root)}:{hashlib.sha256(path.read_bytes()).hexdigest()}")
    return digest(parts)
