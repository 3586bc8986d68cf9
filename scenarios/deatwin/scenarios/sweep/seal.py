"""The seal of a sweep: everything that must not change between its first case and its last."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, Self

from deatwin.plant.errors import DataError

__all__ = ["Sealed", "SweepSeal", "digest", "sources_digest"]

SCHEMA = "deatwin/sweep-seal/1"


class Sealed(Protocol):
    """What a store asks of a seal."""

    @property
    def hash(self) -> str:
        """SHA-256 of everything that must not change."""

    def to_dict(self) -> dict[str, Any]:
        """The content of ``seal.json``."""

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The seal that `to_dict` described, of its data."""

    def require_same(self, other: Self, where: Path) -> None:
        """Raise DataError, which says where and what differs, if cases of this and other may not stand together."""

    def stamp(self, name: str) -> dict[str, Any]:
        """What the file of a case of this name begins with."""


@dataclass(frozen=True, kw_only=True)
class SweepSeal:
    """What must not change between the first case and the last.

    Parameters
    ----------
    schema : str
        Of the files of the cases, such as ``deatwin/study-case/1``.
    parts : mapping of str to plain data
        Code (its hash), versions, seed, settings: each by its name.
    """

    schema: str
    parts: Mapping[str, Any]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of everything that must not change; each case bears it."""
        return digest({"schema": self.schema, "parts": dict(self.parts)})

    def to_dict(self) -> dict[str, Any]:
        """The content of ``seal.json``."""
        return {"schema": SCHEMA, "cases": self.schema, "parts": dict(self.parts), "hash": self.hash}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The seal that `to_dict` described.

        Parameters
        ----------
        data : mapping
            Content of ``seal.json``.

        Returns
        -------
        SweepSeal

        Raises
        ------
        DataError
            If it is none, or its hash is not that of its content.
        """
        try:
            seal, stated = cls(schema=data["cases"], parts=dict(data["parts"])), data["hash"]
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"this is no seal of a sweep: {error!r}") from None
        if seal.hash != stated:
            raise DataError(f"the seal was altered: it states the hash {stated[:12]}, its content has {seal.hash[:12]}")
        return seal

    def require_same(self, other: SweepSeal, where: Path) -> None:
        """Refuse to mix cases that were run under different seals.

        Parameters
        ----------
        other : SweepSeal
            Found in the folder.
        where : path
            The folder, for the message.

        Raises
        ------
        DataError
            Naming each part that differs, as it was and as it is.
        """
        if self.hash == other.hash:
            return
        mine, theirs = {"schema": self.schema, **self.parts}, {"schema": other.schema, **other.parts}
        changed = [name for name in {**theirs, **mine} if digest(mine.get(name)) != digest(theirs.get(name))]
        words = "; ".join(f"{name}: {_short(theirs.get(name))} there, {_short(mine.get(name))} now" for name in changed)
        raise DataError(
            f"{where} was begun under another seal ({words}): its cases cannot be mixed with new ones; go on with what "
            "began it, or take an empty folder"
        )

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
        return {"schema": self.schema, "seal": self.hash, "name": name}


def digest(data: Any) -> str:
    """SHA-256 of plain data, whatever the order of its keys.

    Parameters
    ----------
    data : plain data
        As for JSON.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return hashlib.sha256(json.dumps(data, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def sources_digest(packages: Iterable[str], files: Iterable[Path] = ()) -> str:
    """SHA-256 of the Python sources of packages, and of further files.

    Parameters
    ----------
    packages : iterable of str
        Names, such as ``deatwin.plant``; what lies below them counts.
    files : iterable of path
        Further ones, by their names.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    whole = hashlib.sha256()
    for package in packages:
        for root in import_module(package).__path__:
            for path in sorted(Path(root).rglob("*.py")):
                whole.update(f"{package}/{path.relative_to(root).as_posix()}".encode() + path.read_bytes())
    for path in files:
        whole.update(path.name.encode() + path.read_bytes())
    return whole.hexdigest()


def _short(value: Any) -> str:
    """A part in a few words: of a hash twelve digits."""
    if isinstance(value, str) and len(value) == 64:
        return value[:12]
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 120 else f"{text[:117]}..."
