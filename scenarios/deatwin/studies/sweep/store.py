"""Store the results of cases on disk, one complete file each, under one seal and one lock."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.documents import read_json
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.files import write_text_atomic
from deatwin.plant.files.replacing import replacing
from deatwin.plant.safe_read import DOCUMENT_BYTES, clipped, read_regular
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


CASE_ENDING = ".nc"
SCHEMA = "deatwin/case-file/1"
RECORD = "record"
MAGIC = b"CDF\x01"
UNKNOWN = b"0" * 64
STATED = re.compile(rb"sha256\0\0\0\0\0\x02\0\0\0\x40([0-9a-f]{64})")
"""The hash attribute in the bytes of a file: name, type, length, value."""
INT32 = np.iinfo(np.int32)
HOLD = "it must hold the result of a case: delete it, and the case is run again"
Array = NDArray[Any]


def encode(record: Mapping[str, Any]) -> bytes:
    """Return the content of a case's file."""
    from scipy.io import netcdf_file

    buffer = io.BytesIO()
    with netcdf_file(buffer, "w") as file:
        file.schema, file.sha256 = SCHEMA, UNKNOWN
        text = np.frombuffer(json.dumps(record, ensure_ascii=True).encode("ascii"), dtype="S1")
        _add(file, RECORD, text, (_length(file, f"{RECORD}_length", text.size),))
        found = list(_variables("", record))
        names = _distinct([path for path, _ in found])
        for (path, values), name in zip(found, names, strict=True):
            variable = _add(file, name, values, _dimensions(file, name, values, names))
            if name != path:
                variable.long_name = path.encode("utf-8", "backslashreplace")
        file.flush()
        content = buffer.getvalue()  # before the file closes the buffer
    return _stating(content, hashlib.sha256(content).hexdigest().encode())


def decode(content: bytes) -> dict[str, Any]:
    """Return the case from a file made by `encode`."""
    from scipy.io import netcdf_file

    stated = STATED.search(content)
    if not content.startswith(MAGIC) or stated is None:
        raise ValueError("no file of a case")
    if hashlib.sha256(_stating(content, UNKNOWN)).hexdigest().encode() != stated[1]:
        raise ValueError("damaged or altered")
    with netcdf_file(io.BytesIO(content), "r", mmap=False) as file:
        record: dict[str, Any] = json.loads(file.variables[RECORD].data.tobytes())
    return record


def read_case(path: Path | str) -> dict[str, Any]:
    """Read the file of a case."""
    try:
        return decode(read_regular(path, DOCUMENT_BYTES, ValueError))
    except OSError:
        raise DataError(f"{path}: this case has not been run") from None
    except ValueError as error:
        raise DataError(f"{path}: {error}; {HOLD}") from None


def write_case(path: Path | str, record: Mapping[str, Any]) -> None:
    """Write the file of a case, completely or not at all."""
    content = encode(record)
    with replacing(path) as half:
        half.write_bytes(content)


def _stating(content: bytes, sha256: bytes) -> bytes:
    """Replace the hash in the file; dimension names, which come first, are not surrounded by zero bytes."""
    return STATED.sub(lambda found: found[0][:-64] + sha256, content, count=1)


def _variables(path: str, value: Any) -> Iterator[tuple[str, Array]]:
    """Return the parts of a value that can be variables, by path; rows of a table become columns."""
    if isinstance(value, (list, tuple)) and value and all(isinstance(row, dict) for row in value):
        value = {key: [row.get(key) for row in value] for key in dict.fromkeys(key for row in value for key in row)}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _variables(f"{path}.{key}" if path else str(key), inner)
    elif (array := _array(value)) is not None:
        yield path, array


def _array(value: Any) -> Array | None:
    """Return a value in the classic format; None for nothing, empty values and unequal lengths."""
    if value is None or (isinstance(value, (str, list, tuple)) and not value):
        return None
    if isinstance(value, str):
        return _letters(value)
    if isinstance(value, (list, tuple)) and isinstance(next((v for v in value if v is not None), None), str):
        return _letters(value) if all(v is None or isinstance(v, str) for v in value) else None
    try:
        array = np.array(value)
        if array.dtype.kind == "O" and all(v is None or isinstance(v, (bool, int, float)) for v in array.flat):
            array = array.astype(np.float64)  # None in an array is NaN
    except (ValueError, OverflowError):  # rows of unequal lengths, or a number too large for a float
        return None
    return _narrowed(array) if array.size and array.dtype.kind in "biuf" else None


def _narrowed(array: Array) -> Array:
    """Convert truth values and large integers, which the format does not have."""
    if array.dtype.kind == "b":
        return array.astype(np.int8)
    if array.dtype.kind in "iu":
        return array.astype(np.int32 if array.min() >= INT32.min and array.max() <= INT32.max else np.float64)
    return array.astype(np.float64, copy=False)


def _letters(value: Any) -> Array | None:
    """Return one or several texts as UTF-8 bytes along a last axis."""
    one = isinstance(value, str)
    texts = np.array([(text or "").encode("utf-8", "backslashreplace") for text in ([value] if one else value)])
    if not texts.dtype.itemsize:
        return None
    letters = texts.view("S1").reshape(texts.size, -1)
    return letters[0] if one else letters


def _distinct(paths: list[str]) -> list[str]:
    """Return unique names that every reader accepts."""
    taken = {RECORD, f"{RECORD}_length"}
    return [_free(_lettered(path), taken) for path in paths]


def _lettered(path: str) -> str:
    name = re.sub(r"[^A-Za-z0-9_.+-]", "_", path)[:200]
    return name if name[:1].isalnum() or name[:1] == "_" else f"_{name}"


def _free(name: str, taken: set[str]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free


def _dimensions(file: Any, name: str, values: Array, names: list[str]) -> tuple[str, ...]:
    """Name one dimension per axis, different from all variables, which xarray would take as coordinates."""
    text = values.dtype.kind == "S"
    own = values.shape[:-1] if text else values.shape
    taken = {*names, *file.dimensions}
    found = [_length(file, _free(f"{name}_{axis}", taken), size) for axis, size in enumerate(own)]
    if text:
        found.append(_length(file, _free(f"{name}_text", taken), values.shape[-1]))
    return tuple(found)


def _length(file: Any, name: str, size: int) -> str:
    file.createDimension(name, size)
    return name


def _add(file: Any, name: str, values: Array, dimensions: tuple[str, ...]) -> Any:
    variable = file.createVariable(name, values.dtype.str[1:] if values.dtype.kind != "S" else "S1", dimensions)
    variable[...] = values
    if values.dtype.kind == "S":
        variable._Encoding = "utf-8"  # xarray then decodes it as text
    return variable
