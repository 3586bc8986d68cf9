"""Trial unpacking of files by C libraries in a separate process.

A damaged file can crash SciPy's and HDF5's readers, or keep them busy for ever; here that becomes one clear error.
"""

import hashlib
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from enum import Enum
from multiprocessing import spawn
from typing import TypeVar

from deatwin.plant.errors import DataError

SECONDS = 60.0  # Longest trial of a small file, s
BYTES_PER_SECOND = 2_000_000  # Rate at which a slow machine with a slow disk unpacks
_ENDING = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")  # Signals sent by the system or the user, not caused by a fault
_FROM_OUTSIDE = tuple(-getattr(signal, name) for name in _ENDING if hasattr(signal, name))
_BEGUN, _THROUGH = b"begun", b"through"
# Python's exceptions are ignored here; unpacking in the calling process raises them again.
_PROGRAM = """
import importlib, json, sys
sys.path[:] = json.loads(sys.argv[1])
unpack = getattr(importlib.import_module(sys.argv[2]), sys.argv[3])
content = sys.stdin.buffer.read()
sys.stdout.write("begun ")
sys.stdout.flush()
try:
    unpack(content, *sys.argv[4:])
except Exception:
    pass
sys.stdout.write("through")
"""
_survived: set[tuple[str, ...]] = set()  # Cases that need no second trial

Content = TypeVar("Content")


class Outcome(Enum):
    """Result of a trial; each value says what is wrong with the file."""

    THROUGH = "it can be unpacked"
    UNTRIED = "no process could be started to try it"
    CRASHED = "the library that unpacks it crashes; the file is damaged"
    BUSY = "the library that unpacks it does not return; the file is damaged"
    ENDED = "the process that unpacked it was ended from outside, perhaps because of too little memory; try again"

    @property
    def is_fault(self) -> bool:
        """True if the file should not be unpacked in this process."""
        return self not in (Outcome.THROUGH, Outcome.UNTRIED)


def unpacked(unpack: Callable[..., Content], content: bytes, path: str, *wanted: str) -> Content:
    """Return a function's result for a file, after another process has tried it without crashing."""
    case = (unpack.__module__, unpack.__name__, hashlib.sha256(content).hexdigest(), *wanted)
    if case not in _survived:
        outcome = trial(unpack, content, path, *wanted)
        if outcome.is_fault:
            raise DataError(f"{path}: {outcome.value}")
        if outcome is Outcome.THROUGH:
            _survived.add(case)
    return unpack(content, path, *wanted)


def trial(unpack: Callable[..., object], content: bytes, path: str, *wanted: str) -> Outcome:
    """Try to unpack a file in another process, and report the outcome."""
    program = spawn.get_executable()
    if getattr(sys, "frozen", False) or not program:
        return Outcome.UNTRIED  # there is no interpreter to start; a frozen program would start itself
    # -P: modules in the working folder are not imported
    command = [program, "-P", "-c", _PROGRAM, json.dumps(sys.path), unpack.__module__, unpack.__name__, path, *wanted]
    most = SECONDS + len(content) / BYTES_PER_SECOND
    try:
        ended = subprocess.run(command, input=content, timeout=most, capture_output=True, check=False)
    except subprocess.TimeoutExpired:
        return Outcome.BUSY
    except OSError:
        return Outcome.UNTRIED
    if _THROUGH in ended.stdout:
        return Outcome.THROUGH
    if _BEGUN not in ended.stdout:
        return Outcome.UNTRIED
    return Outcome.ENDED if ended.returncode in _FROM_OUTSIDE else Outcome.CRASHED
