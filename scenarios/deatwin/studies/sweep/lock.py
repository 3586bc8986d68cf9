"""A lock that allows one run at a time in a folder; the system releases it if the process is killed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deatwin.plant.errors import DataError

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
