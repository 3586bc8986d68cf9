"""Files that C libraries unpack are unpacked in a process of its own first.

A damaged file can crash SciPy's and HDF5's readers, or keep them busy for ever, and with them every program that
asked for it. What becomes of the process of the trial is one clear error here.
"""

import hashlib
import subprocess
import sys
from typing import Protocol, TypeVar

from deatwin.plant.errors import DataError

__all__ = ["Unpacker", "trial", "unpacked"]

SECONDS = 60.0  # that a trial may take for a small file
BYTES_PER_SECOND = 2_000_000  # that a slow disk and a slow machine unpack
_FAULTS = 0xC0000000  # exit codes of Windows from here on are faults of the process (NTSTATUS, severity "error")
_PROGRAM = (
    "import importlib, sys; unpack = getattr(importlib.import_module(sys.argv[1]), sys.argv[2]); "
    "unpack(sys.stdin.buffer.read(), *sys.argv[3:])"
)
_survived: set[tuple[str, ...]] = set()  # what need not be tried again

Content = TypeVar("Content", covariant=True)


class Unpacker(Protocol[Content]):
    """A function of a module that unpacks the bytes of a file."""

    __module__: str
    __name__: str

    def __call__(self, content: bytes, path: str, /, *wanted: str) -> Content:
        """Unpack.

        Parameters
        ----------
        content : bytes
            The file.
        path : str
            Its name, for error texts.
        *wanted : str
            What of it, where not all is needed.

        Returns
        -------
        object
        """


def unpacked(unpack: Unpacker[Content], content: bytes, path: str, *wanted: str) -> Content:
    """Return what a function makes of a file, unless it does not survive that.

    Parameters
    ----------
    unpack : callable
        A function of a module, which is given the bytes of the file, its name, and what of it is wanted.
    content : bytes
        The file.
    path : str
        Its name, for error texts.
    *wanted : str
        What of it.

    Returns
    -------
    whatever `unpack` returns

    Raises
    ------
    DataError
        If the trial in another process crashed or took too long; besides, what `unpack` raises.
    """
    case = (unpack.__module__, unpack.__name__, hashlib.sha256(content).hexdigest(), *wanted)
    if case not in _survived:
        if end := trial(unpack, content, path, *wanted):
            raise DataError(f"{path}: {end}; the file is damaged")
        _survived.add(case)
    return unpack(content, path, *wanted)


def trial(unpack: Unpacker[object], content: bytes, path: str, *wanted: str) -> str:
    """Unpack a file in another process, and say how that went.

    Parameters
    ----------
    unpack : callable
        A function of a module.
    content : bytes
        The file.
    path : str
        Its name.
    *wanted : str
        What of it.

    Returns
    -------
    str
        What became of the process, empty where it came to its end: with errors of Python, too, since those can be
        raised in this one.
    """
    if getattr(sys, "frozen", False) or not sys.executable:
        return ""  # there is no interpreter to start: a program of one file would begin again
    # -P: what lies in the working folder is not imported
    command = [sys.executable, "-P", "-c", _PROGRAM, unpack.__module__, unpack.__name__, path, *wanted]
    most = SECONDS + len(content) / BYTES_PER_SECOND
    try:
        code = subprocess.run(command, input=content, timeout=most, capture_output=True, check=False).returncode
    except subprocess.TimeoutExpired:
        return f"the library that unpacks it was still busy after {most:.0f} s"
    return "the library that unpacks it crashes" if code < 0 or code >= _FAULTS else ""
