"""Write files such that they appear complete or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deatwin.plant.errors import DataError
from deatwin.plant.safe_read import kind_of_file


def place_of(path: str | os.PathLike[str]) -> Path:
    """Return the path that will be written: for a link, its target."""
    if os.fspath(path) == "-":
        raise DataError("-: results are not written to standard output; give the name of a file")
    target = Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)
    if kind := kind_of_file(target):
        raise DataError(f"{path}: this is {kind}; give the name of a file")
    return target


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a temporary file that replaces a file if no error occurs."""
    target = place_of(path)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # raised if the file could not be created, for example below a file
            temporary.unlink(missing_ok=True)
