"""Store the results of cases on disk, one complete file each, under one seal and one lock."""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from deatwin.plant.documents import read_json
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.files import write_text_atomic
from deatwin.plant.safe_read import clipped
from deatwin.studies.sweep.casefile import CASE_ENDING, read_case, write_case
from deatwin.studies.sweep.seal import SweepSeal


def read_object(path: Path, wanted: str = "an object") -> dict[str, Any]:
    """Return the object in a JSON file."""
    try:
        found = read_json(path)
    except ModelError as error:
        raise DataError(f"{error}; it must hold {wanted}") from None
    if not isinstance(found, dict):
        raise DataError(f"{path}: it must hold {wanted}")
    return found


LOCK_FILE = ".lock"


@contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder."""
    path = folder / LOCK_FILE
    held = _held(path)
    try:
        yield
    finally:
        with suppress(PermissionError):  # Windows cannot remove an open file; it stays there
            path.unlink(missing_ok=True)
        os.close(held)
        with suppress(OSError):
            folder.rmdir()


def _held(path: Path) -> int:
    """Return the open, locked lock file."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT)
        except FileNotFoundError:  # a run that has just ended removed the folder
            continue
        try:
            _lock(file)
        except (BlockingIOError, PermissionError):
            os.close(file)
            raise DataError(f"{path.parent.parent}: another process is running these cases; wait for it") from None
        except OSError:
            return file
        with suppress(FileNotFoundError):
            if os.fstat(file).st_ino == path.stat().st_ino:
                return file
        os.close(file)  # the run that held the lock has removed the file


def _lock(file: int) -> None:
    if os.name == "nt":
        import msvcrt

        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


SEAL_FILE = "seal.json"
RUNNING = "running"
SIDE_BY_SIDE = 2000  # Most cases in a single folder; more are spread over subfolders
GRACE = 1.0  # Time within which the workers of a killed run end, s
SHARDS = tuple(f"{number:02x}" for number in range(256))
NAME = re.compile(r"[A-Za-z0-9_+-][A-Za-z0-9_.+-]{0,199}")

Content = TypeVar("Content")


class CaseStore:
    """Results of a sealed sweep on disk."""

    def __init__(self, folder: Path | str, seal: SweepSeal, *, cases: str = "cases", expected: int = 0) -> None:
        self.seal, self.folder = seal, Path(folder).absolute()
        self.cases = self.folder / cases
        self.cases.mkdir(parents=True, exist_ok=True)
        self.spread = (self.cases / SHARDS[0]).is_dir()
        path = self.folder / SEAL_FILE
        if path.exists():
            seal.require_same(read_seal(folder), Path(folder))
        else:
            if self.names():
                raise DataError(f"{self.folder} holds cases but no {SEAL_FILE}, so their conditions are unknown")
            if expected > SIDE_BY_SIDE and not self.spread:
                for shard in reversed(SHARDS):  # the first is made last: it shows that all exist
                    (self.cases / shard).mkdir(exist_ok=True)
                self.spread = True
            write_text_atomic(path, json.dumps(seal.to_dict(), indent=1) + "\n")
        self.sealed_as = path.read_text(encoding="utf-8")

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Write the result of a case, unless it has one."""
        if self._sealed_as() != self.sealed_as:
            raise DataError(f"{self.folder}: resealed since this case was begun; its result is not written")
        path = self.path(name)
        if path.exists():
            return
        write_case(path, {**self.seal.stamp(name), **result})

    def get(self, name: str) -> dict[str, Any]:
        """Read the result of a case."""
        path = self.path(name)
        found = read_case(path)
        stamped = {key: found.get(key) for key in self.seal.stamp(name)}
        if stamped != self.seal.stamp(name):
            raise DataError(f"{path}: this case was run under another seal than {SEAL_FILE} states")
        return found

    def read(self, name: str, build: Callable[[dict[str, Any]], Content], noun: str = "case") -> Content:
        """Read a case and convert it to its object."""
        found = self.get(name)
        try:
            return build(found)
        except (ModelError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.path(name)}: it must hold a {noun} ({error!r}); delete it, and it is run again"
            ) from None

    def has(self, name: str) -> bool:
        """Return whether a case is finished."""
        return self.path(name).exists()

    def names(self) -> set[str]:
        """Return the names of the finished cases."""
        found: set[str] = set()
        for folder in self._folders():
            with os.scandir(folder) as entries:
                there = [entry.name for entry in entries if entry.name[0] != "."]
            found.update(name.removesuffix(CASE_ENDING) for name in there if name.endswith(CASE_ENDING))
        return found

    def missing(self, names: Sequence[str]) -> list[str]:
        """Return the names of the cases that are not finished."""
        through = self.names()
        return [name for name in names if name not in through]

    def discard(self, names: Iterable[str]) -> None:
        """Remove results, so that the cases are repeated when the sweep is resumed."""
        for name in names:
            self.path(name).unlink(missing_ok=True)

    def path(self, name: str) -> Path:
        """Return the path of a case's file."""
        if not NAME.fullmatch(name):
            raise DataError(f"a case cannot be called {name!r}: letters, digits and _ . + - only, 200 at most")
        folder = self.cases / hashlib.sha256(name.encode()).hexdigest()[:2] if self.spread else self.cases
        return folder / f"{name}{CASE_ENDING}"

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        """Mark a case as running; if its worker is killed, the mark remains."""
        note = self.folder / RUNNING / name
        note.parent.mkdir(exist_ok=True)
        note.touch()
        try:
            yield
        finally:
            note.unlink(missing_ok=True)

    def left_running(self) -> list[str]:
        """Return the cases whose worker was killed, and remove their marks."""
        notes = [note for note in (self.folder / RUNNING).glob("*") if note.name[0] != "."]
        for note in notes:
            note.unlink(missing_ok=True)
        return [note.name for note in notes]

    @contextmanager
    def exclusive_lock(self) -> Iterator[None]:
        """Lock the folder and remove the remains of a killed run; DataError if another process runs this sweep."""
        with exclusive_lock(self.folder / RUNNING):
            if self.left_running():
                time.sleep(GRACE)
            for folder in self._folders():
                with os.scandir(folder) as entries:
                    halves = [e.path for e in entries if e.name[0] == "." and f"{CASE_ENDING}." in e.name]
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


def read_seal(folder: Path | str) -> SweepSeal:
    """Read the seal of a folder."""
    path = Path(folder) / SEAL_FILE
    found = read_object(path, "the seal of a study; a study is sealed before its first case")
    try:
        return SweepSeal.from_dict(found)
    except DataError as error:
        raise DataError(f"{path}: {clipped(error, 400)}") from None
