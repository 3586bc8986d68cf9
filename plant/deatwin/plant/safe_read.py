"""Safe reading of users' files: plain files of a limited size only (docs/how-to/files-and-export.md)."""

import os
import stat
from collections.abc import Callable

RECORDING_BYTES = 2_000_000_000
"""Largest size of a recording of any format, packed and unpacked: 83 million samples of a time and two signals."""
TEXT_BYTES = 1_000_000_000
"""Largest size of a recording as text, whose numbers take several times as much memory while they are read."""
ROWS = 20_000_000  # Largest number of rows of a recording as text: 111 hours at 50 Hz
COLUMNS = 10_000  # Largest number of columns of a recording
DOCUMENT_BYTES = 500_000_000  # Largest size of a model, a diagnosis or a check (JSON)
DOCUMENT_VALUES = 20_000_000  # Largest number of values, texts and lists in such a file
RIG_BYTES = 1_000_000  # Largest size of a rig file (TOML)

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def read_regular(path: str | os.PathLike[str], limit: int, refuse: Callable[[str], Exception]) -> bytes:
    """Return the bytes of a plain file that is not too large."""
    try:
        # Without O_NONBLOCK, a pipe would wait for a writer; systems that lack the flag do not need it.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        if os.path.islink(path):
            raise refuse(f"this is a link to {os.readlink(path)}, which does not exist") from None
        raise
    except ValueError:  # a null character in the name
        raise refuse("no name of a file") from None
    with open(descriptor, "rb") as file:
        found = os.fstat(file.fileno())
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(21, "Is a directory")
        if not stat.S_ISREG(found.st_mode):
            raise refuse(f"this is {_KINDS.get(stat.S_IFMT(found.st_mode), 'not a file')}; give a plain file")
        content = file.read(found.st_size + 1) if found.st_size <= limit else b""  # the file may be growing
    if max(found.st_size, len(content)) > limit:
        raise refuse(f"the file is too large: {in_words(found.st_size)}; at most {in_words(limit)} can be read")
    return content


def kind_of_file(path: str | os.PathLike[str]) -> str:
    """Return the kind of a path that is not a plain file, such as ``"a pipe"``."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return ""
    return "" if stat.S_ISREG(mode) else _KINDS.get(stat.S_IFMT(mode), "no plain file")


def in_words(count: float) -> str:
    """Return a number of bytes with a unit."""
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} bytes"


def clipped(text: object, length: int = 80) -> str:
    r"""Return content of a file, printable and shortened, for an error text.

    >>> clipped("one"), clipped("x" * 100, 5), clipped("a\x1b[31m")
    ('one', 'xxxxx…', 'a\\x1b[31m')
    """
    whole = str(text)
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in whole[:length])
    return shown + ("…" if len(whole) > length else "")


def reason(error: Exception) -> str:
    """Return the reason why a library could not read a file, for an error text.

    >>> reason(ValueError("no such block")), reason(MemoryError()), reason(KeyError())
    ('no such block', 'it needs more memory than there is', 'KeyError')
    """
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    return clipped(error, 200) or type(error).__name__
