"""Store the results of cases on disk, one complete file each, under one seal."""

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

from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.files import write_text_atomic
from deatwin.plant.safe_read import clipped
from deatwin.studies.sweep.casefile import CASE_ENDING, read_case, write_case
from deatwin.studies.sweep.json_files import read_object
from deatwin.studies.sweep.lock import exclusive_lock
from deatwin.studies.sweep.seal import SweepSeal

SEAL_FILE = "seal.json"
RUNNING = "running"
SIDE_BY_SIDE = 2000  # Most cases in a single folder; more are spread over subfolders
GRACE = 1.0  # Time within which the workers of a killed run end, s
SHARDS = tuple(f"{number:02x}" for number in range(256))
NAME = re.compile(r"[A-Za-z0-9_+-][A-Za-z0-9_.+-]{0,199}")

Content = TypeVar("Content")


class CaseStore:
    """Results of a sealed sweep on disk.

    Any number of processes may write at the same time. Each case is a NetCDF file in the folder ``cases``. Large sweeps
    are spread over 256 subfolders, ``00`` to ``ff``, by the first digits of the SHA-256 of the names.

    Parameters
    ----------
    folder : path
        Folder of the sweep. On a cluster all workers must see it under this path.
    seal : SweepSeal
        Seal of the present run; written if the folder has none.
    cases : str
        Name of the folder for the cases.
    expected : int
        Expected number of cases, which decides whether a new folder is spread over subfolders.

    Raises
    ------
    DataError
        If the folder was begun under another seal, or holds cases but no seal.
    """

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
        """Write the result of a case, unless it has one.

        Parameters
        ----------
        name : str
            Name of the case.
        result : mapping
            Plain data: mappings with texts as keys, lists, texts, numbers, truth values and None; `get` returns the
            same.

        Raises
        ------
        DataError
            If the folder has been resealed in the meantime, or the file cannot be written.
        """
        if self._sealed_as() != self.sealed_as:
            raise DataError(f"{self.folder}: resealed since this case was begun; its result is not written")
        path = self.path(name)
        if path.exists():
            return
        write_case(path, {**self.seal.stamp(name), **result})

    def get(self, name: str) -> dict[str, Any]:
        """Read the result of a case.

        Parameters
        ----------
        name : str
            Name of the case.

        Returns
        -------
        dict
            Stamp of the seal, followed by the saved values.

        Raises
        ------
        DataError
            If there is no such file, it is damaged or not a case file, or it was run under another seal.
        """
        path = self.path(name)
        found = read_case(path)
        stamped = {key: found.get(key) for key in self.seal.stamp(name)}
        if stamped != self.seal.stamp(name):
            raise DataError(f"{path}: this case was run under another seal than {SEAL_FILE} states")
        return found

    def read(self, name: str, build: Callable[[dict[str, Any]], Content], noun: str = "case") -> Content:
        """Read a case and convert it to its object.

        Parameters
        ----------
        name : str
            Name of the case.
        build : callable
            Function of what `get` returns.
        noun : str
            Word for a case in the error.

        Raises
        ------
        DataError
            For the reasons given in `get`, or if the file does not describe such an object.
        """
        found = self.get(name)
        try:
            return build(found)
        except (ModelError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.path(name)}: it must hold a {noun} ({error!r}); delete it, and it is run again"
            ) from None

    def has(self, name: str) -> bool:
        """Return whether a case is finished.

        Parameters
        ----------
        name : str
            Name of the case.

        Returns
        -------
        bool
        """
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
        """Return the names of the cases that are not finished.

        Parameters
        ----------
        names : sequence of str
            All cases.

        Returns
        -------
        list of str
            Their names, in the same order.
        """
        through = self.names()
        return [name for name in names if name not in through]

    def discard(self, names: Iterable[str]) -> None:
        """Remove results, so that the cases are repeated when the sweep is resumed.

        Parameters
        ----------
        names : iterable of str
            Names of the cases.
        """
        for name in names:
            self.path(name).unlink(missing_ok=True)

    def path(self, name: str) -> Path:
        """Return the path of a case's file.

        Parameters
        ----------
        name : str
            Name of the case: at most 200 letters, digits and ``_ . + -``, not beginning with a dot.

        Returns
        -------
        path

        Raises
        ------
        DataError
            If the name cannot be that of a file.
        """
        if not NAME.fullmatch(name):
            raise DataError(f"a case cannot be called {name!r}: letters, digits and _ . + - only, 200 at most")
        folder = self.cases / hashlib.sha256(name.encode()).hexdigest()[:2] if self.spread else self.cases
        return folder / f"{name}{CASE_ENDING}"

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        """Mark a case as running; if its worker is killed, the mark remains.

        Parameters
        ----------
        name : str
            Name of the case.
        """
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
        """Lock the folder against a second run, and remove the remains of a killed run.

        Raises
        ------
        DataError
            If another process is running this sweep.
        """
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
