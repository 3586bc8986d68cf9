"""The seal of a sweep: everything that must not change between its first and its last case."""

from __future__ import annotations

import hashlib
import json
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Self

import numpy as np

from deatwin.plant.errors import DataError

DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")  # Packages whose numbers decide a verdict


def thresholds() -> dict[str, Any]:
    """Collect the constants of the deciding packages that are numbers or groups of numbers, by module and name."""
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
    """Return the value as plain data if it is made of numbers, else None."""
    if isinstance(value, (bool, int, float)):
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


SCHEMA = "deatwin/sweep-seal/1"


@dataclass(frozen=True, kw_only=True)
class SweepSeal:
    """Everything that must not change between the first case of a sweep and its last; each case bears its hash."""

    schema: str
    parts: Mapping[str, object]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of everything that must not change; each case bears it."""
        return digest({"schema": self.schema, "parts": dict(self.parts)})

    def to_dict(self) -> dict[str, Any]:
        """The content of ``seal.json``."""
        return {"schema": SCHEMA, "cases": self.schema, "parts": dict(self.parts), "hash": self.hash}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read the seal from the content of ``seal.json``."""
        try:
            seal, stated = cls(schema=data["cases"], parts=dict(data["parts"])), data["hash"]
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"this version cannot continue a study with this seal: {error!r}") from None
        if seal.hash != stated:
            raise DataError(
                f"the seal was altered: it states the hash {_short(stated)}, its content has {seal.hash[:12]}"
            )
        return seal

    def require_same(self, other: SweepSeal, where: Path) -> None:
        """Raise an error that names what differs from the seal found in a folder."""
        if changed := self.changes(other):
            raise DataError(
                f"{where} was begun under another seal ({changed}): its cases cannot be mixed with new ones; continue "
                f"with the original version, or use an empty folder"
            )

    def changes(self, other: SweepSeal) -> str:
        """Say how this seal differs from `other`; empty if cases of both may be mixed."""
        mine, theirs = {"schema": self.schema, **self.parts}, {"schema": other.schema, **other.parts}
        told = []
        for name in {**theirs, **mine}:
            then, now = theirs.get(name), mine.get(name)
            if digest(then) == digest(now):
                continue
            if isinstance(then, Mapping) and isinstance(now, Mapping):
                same = {key for key in then if key in now and digest(then[key]) == digest(now[key])}
                then, now = ({key: value for key, value in part.items() if key not in same} for part in (then, now))
            told.append(f"{name}: {_short(then)} there, {_short(now)} now")
        return "; ".join(told)

    def stamp(self, name: str) -> dict[str, Any]:
        """Schema, hash of the seal, and name of the case: the entries with which the file of a case begins."""
        return {"schema": self.schema, "seal": self.hash, "name": name}


def digest(data: Any) -> str:
    """Return the SHA-256 of plain data, independent of the order of its keys."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def sources_digest(packages: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Return the SHA-256 of the Python and C sources of packages and of further files."""
    whole = hashlib.sha256()
    for package in packages:
        for root in import_module(package).__path__:
            for path in sorted(p for p in Path(root).rglob("*") if p.suffix in (".py", ".c")):
                whole.update(f"{package}/{path.relative_to(root).as_posix()}".encode() + path.read_bytes())
    for path in files:
        whole.update(path.name.encode() + path.read_bytes())
    return whole.hexdigest()


def _short(value: Any) -> str:
    """Write a part in a few words; for a hash, twelve digits."""
    if isinstance(value, str) and len(value) == 64:
        return value[:12]
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 120 else f"{text[:117]}..."
