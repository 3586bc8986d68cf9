"""Results of cases on the disk: one file each, whole or absent, under one seal."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Generic, TypeVar

from deatwin.plant.errors import DataError
from deatwin.plant.files import write_text_atomic
from deatwin.scenarios.sweep.lock import alone
from deatwin.scenarios.sweep.seal import Sealed

__all__ = ["CaseStore", "read_seal"]

SEAL_FILE = "seal.json"
RUNNING = "running"
SIDE_BY_SIDE = 2000
"""Up to so many cases lie in one folder; more are spread."""
GRACE = 1.0
"""Workers of a run that was killed end within this time, s."""
SHARDS = tuple(f"{number:02x}" for number in range(256))
NAME = re.compile(r"[A-Za-z0-9_+-][A-Za-z0-9_.+-]{0,199}")

S = TypeVar("S", bound=Sealed)


class CaseStore(Generic[S]):
    """The cases of a sealed sweep.

    Any number of processes may write into it. A case is a JSON file in the folder ``cases``; where there are to be
    many, they are spread over 256 folders in it, ``00`` to ``ff``, by the first digits of the SHA-256 of their names.

    Parameters
    ----------
    folder : path
        Of the sweep. On a cluster all workers must see it under this path.
    seal : Sealed
        Of the sweep as it is to be run now. It is written if the folder has none.
    cases : str
        Name of the folder for the cases.
    expected : int
        How many cases are to come: it decides whether those of a new folder are spread.

    Raises
    ------
    DataError
        If the folder was begun under another seal, or holds cases but no seal.
    """

    indent: int | None = None
    """Of the files; without one they are written fastest."""

    def __init__(self, folder: Path | str, seal: S, *, cases: str = "cases", expected: int = 0) -> None:
        self.seal, self.folder = seal, Path(folder).absolute()
        self.cases = self.folder / cases
        self.cases.mkdir(parents=True, exist_ok=True)
        self.spread = (self.cases / SHARDS[0]).is_dir()
        path = self.folder / SEAL_FILE
        if path.exists():
            seal.require_same(read_seal(type(seal), folder), Path(folder))
        else:
            self.adopt()
            if expected > SIDE_BY_SIDE and not self.spread:
                for shard in reversed(SHARDS):  # the first comes last: it tells that all are there
                    (self.cases / shard).mkdir(exist_ok=True)
                self.spread = True
            write_text_atomic(path, json.dumps(seal.to_dict(), indent=1) + "\n")
        self.sealed_as = path.read_text(encoding="utf-8")

    def adopt(self) -> None:
        """Look at what a folder without a seal holds.

        Raises
        ------
        DataError
            If it holds cases.
        """
        if self.names():
            raise DataError(f"{self.folder} holds cases but no {SEAL_FILE}: what they were run under cannot be known")

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case; one that is there already is left as it is.

        Parameters
        ----------
        name : str
            Of the case.
        result : mapping
            Plain data; a number that is not finite becomes null.

        Raises
        ------
        DataError
            If the folder has been sealed anew since, or the file cannot be written.
        """
        if self._sealed_as() != self.sealed_as:
            raise DataError(f"{self.folder}: sealed anew since this case was begun; its result is not written")
        path = self.path(name)
        if path.exists():
            return
        content = {**self.seal.stamp(name), **_finite(dict(result))}
        write_text_atomic(path, json.dumps(content, indent=self.indent, ensure_ascii=False, allow_nan=False) + "\n")

    def get(self, name: str) -> dict[str, Any]:
        """Read the result of a case.

        Parameters
        ----------
        name : str
            Of the case.

        Returns
        -------
        dict
            What was written, and ahead of it what the seal stamps.

        Raises
        ------
        DataError
            If there is none, it is no JSON, or it was run under another seal.
        """
        path = self.path(name)
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            stamped = {key: found.get(key) for key in self.seal.stamp(name)}
        except OSError:
            raise DataError(f"{path}: this case has not been run") from None
        except json.JSONDecodeError as error:
            raise DataError(f"{path}: line {error.lineno}: {error.msg}; {_HOLD}") from None
        except (ValueError, AttributeError):
            raise DataError(f"{path}: {_HOLD}") from None
        if stamped != self.seal.stamp(name):
            raise DataError(f"{path}: this case was run under another seal than {SEAL_FILE} states")
        return found

    def has(self, name: str) -> bool:
        """Whether a case is through.

        Parameters
        ----------
        name : str
            Of the case.

        Returns
        -------
        bool
        """
        return self.path(name).exists()

    def names(self) -> set[str]:
        """The cases that are through."""
        found: set[str] = set()
        for folder in self._folders():
            with os.scandir(folder) as entries:
                found.update(e.name[:-5] for e in entries if e.name.endswith(".json") and e.name[0] != ".")
        return found

    def missing(self, names: Sequence[str]) -> list[str]:
        """The cases that are not through.

        Parameters
        ----------
        names : sequence of str
            All cases.

        Returns
        -------
        list of str
            In the same order.
        """
        through = self.names()
        return [name for name in names if name not in through]

    def discard(self, names: Iterable[str]) -> None:
        """Remove results: the cases are run again when the sweep is gone on with.

        Parameters
        ----------
        names : iterable of str
            Of the cases.
        """
        for name in names:
            self.path(name).unlink(missing_ok=True)

    def path(self, name: str) -> Path:
        """The file of a case.

        Parameters
        ----------
        name : str
            Of the case: letters, digits and ``_ . + -``, 200 at most, no dot in front.

        Returns
        -------
        path

        Raises
        ------
        DataError
            If a file cannot bear the name.
        """
        if not NAME.fullmatch(name):
            raise DataError(f"a case cannot be called {name!r}: letters, digits and _ . + - only, 200 at most")
        folder = self.cases / hashlib.sha256(name.encode()).hexdigest()[:2] if self.spread else self.cases
        return folder / f"{name}.json"

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        """Note that a case is being run; of a worker that was killed the note stays.

        Parameters
        ----------
        name : str
            Of the case.
        """
        note = self.folder / RUNNING / name
        note.parent.mkdir(exist_ok=True)
        note.touch()
        try:
            yield
        finally:
            note.unlink(missing_ok=True)

    def left_running(self) -> list[str]:
        """The cases that were being run when their worker was killed; the notes of them are removed."""
        notes = [note for note in (self.folder / RUNNING).glob("*") if note.name[0] != "."]
        for note in notes:
            note.unlink(missing_ok=True)
        return [note.name for note in notes]

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep a second run off the folder, and clear away what a killed one left.

        Raises
        ------
        DataError
            If another process is running this sweep.
        """
        with alone(self.folder / RUNNING):
            if self.left_running():
                time.sleep(GRACE)
            for folder in self._folders():
                with os.scandir(folder) as entries:
                    halves = [e.path for e in entries if e.name[0] == "." and ".json." in e.name]
                for half in halves:
                    with suppress(OSError):
                        os.unlink(half)
            yield

    def _folders(self) -> list[Path]:
        return [self.cases / shard for shard in SHARDS] if self.spread else [self.cases]

    def _sealed_as(self) -> str:
        try:
            return (self.folder / SEAL_FILE).read_text(encoding="utf-8")
        except OSError:
            return ""


_HOLD = "it must hold the result of a case: delete it, and the case is run again"


def read_seal(kind: type[S], folder: Path | str) -> S:
    """The seal of a folder.

    Parameters
    ----------
    kind : type
        Of the seal.
    folder : path
        Of a sweep.

    Returns
    -------
    Sealed

    Raises
    ------
    DataError
        If it has none.
    """
    path = Path(folder) / SEAL_FILE
    try:
        return kind.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except OSError:
        raise DataError(f"{path}: no such file; a study is sealed before its first case") from None
    except json.JSONDecodeError as error:
        raise DataError(f"{path}: line {error.lineno}: {error.msg}; it must hold the seal of a study") from None


def _finite(data: Any) -> Any:
    """Plain data without what JSON does not know: what is not finite becomes null."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
