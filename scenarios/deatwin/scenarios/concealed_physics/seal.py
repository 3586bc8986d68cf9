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

from deatwin.plant.errors import DataError
from deatwin.scenarios.sweep.seal import digest

__all__ = ["DECIDING", "SCHEMA", "Seal", "digest", "thresholds"]

SCHEMA = "deatwin/concealed-seal/1"
CASE_SCHEMA = "deatwin/concealed-case/1"
DECIDING = ("deatwin.ident.mismatch", "deatwin.ident.greybox")
"""Packages whose numbers decide a verdict."""
SEALED_CODE = ("deatwin.plant", "deatwin.ident", "deatwin.scenarios.concealed_physics")
OPEN_CODE = frozenset({
    "__init__.py", "score.py", "opened.py", "rates.py", "confusion.py", "tables.py", "page.py", "figures.py",
})  # fmt: skip
"""Of this folder: what counts and draws. It has a hash of its own, and the report says whether it changed."""


@dataclass(frozen=True, kw_only=True)
class Seal:
    """What must not change between the first case and the last.

    Parameters
    ----------
    size : str
        Of the study.
    seed : int
        Of the study.
    key : str
        SHA-256 of all labels: the cases with what is concealed in each, and which names are right for it.
    thresholds : mapping of str to value
        Every number that decides, by module and name.
    code : str
        SHA-256 of the sources of plant, identification, generator and runner.
    scoring : str
        SHA-256 of the sources that count and draw; the only part that may change, and then the report says so.
    version : str
        Of deatwin.
    """

    size: str
    seed: int
    key: str
    thresholds: Mapping[str, Any]
    code: str
    scoring: str
    version: str

    @classmethod
    def of(cls, size: str, seed: int, key: Mapping[str, Any]) -> Self:
        """Seal a study with the code as it is now.

        Parameters
        ----------
        size : str
            Of the study.
        seed : int
            Of the study.
        key : mapping
            All labels as plain data.

        Returns
        -------
        Seal
        """
        return cls(
            size=size, seed=seed, key=digest(key), thresholds=thresholds(), code=_sources(counting=False),
            scoring=_sources(counting=True), version=version("deatwin"),
        )  # fmt: skip

    @property
    def hash(self) -> str:
        """SHA-256 of everything that must not change; each case bears it."""
        return digest({name: value for name, value in asdict(self).items() if name != "scoring"})

    def to_dict(self) -> dict[str, Any]:
        """The content of ``seal.json``."""
        return {"schema": SCHEMA, **asdict(self), "hash": self.hash}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The seal that `to_dict` described.

        Parameters
        ----------
        data : mapping
            Content of ``seal.json``.

        Returns
        -------
        Seal

        Raises
        ------
        DataError
            If it is none, or its hash is not that of its content.
        """
        try:
            seal = cls(**{name: data[name] for name in cls.__dataclass_fields__})
            stated = data["hash"]
        except (KeyError, TypeError) as error:
            raise DataError(f"this is no seal of a study: {error!r}") from None
        if seal.hash != stated:
            raise DataError(f"the seal was altered: it states the hash {stated[:12]}, its content has {seal.hash[:12]}")
        return seal

    def stamp(self, name: str) -> dict[str, Any]:
        """What the file of a case begins with.

        Parameters
        ----------
        name : str
            Of the case.

        Returns
        -------
        dict
            Schema, hash of the seal, name.
        """
        return {"schema": CASE_SCHEMA, "seal": self.hash, "name": name}

    def require_same(self, other: Seal, where: Path) -> None:
        """Refuse to mix cases that were run under different seals.

        Parameters
        ----------
        other : Seal
            Found in the folder.
        where : path
            The folder, for the message.

        Raises
        ------
        DataError
            Naming what differs.
        """
        mine, theirs = asdict(self), asdict(other)
        changed = [name for name in mine if name != "scoring" and mine[name] != theirs[name]]
        if "thresholds" in changed:
            names = {*mine["thresholds"], *theirs["thresholds"]}
            moved = sorted(n for n in names if mine["thresholds"].get(n) != theirs["thresholds"].get(n))
            changed[changed.index("thresholds")] = f"thresholds ({', '.join(moved[:3])})"
        if changed:
            raise DataError(
                f"{where} was begun under another seal ({', '.join(changed)} changed since): its cases cannot be mixed "
                "with new ones; go on with the version that began it, or take an empty folder"
            )


def thresholds() -> dict[str, Any]:
    """Every module constant of the deciding packages that is a number or a group of numbers.

    Returns
    -------
    dict of str to value
        By module and name, in order.
    """
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
