"""Import packages that only some formats need."""

import importlib
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from deatwin.plant.errors import DataError
from deatwin.plant.safe_read import reason


def require(package: str, purpose: str) -> Any:
    """Import a package; raise DataError with the command that installs it if it is missing."""
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise DataError(f"{purpose} needs the package {error.name}: pip install {package}") from None


@contextmanager
def reading(path: str, format_name: str, *, logger: str = "", harmless: tuple[str, ...] = ()) -> Iterator[None]:
    """Convert any error or warning of a library about a damaged file to one clear error."""
    doubts: list[str] = []
    known = list(logging.root.manager.loggerDict) if logger else []
    logs = [logging.getLogger(name) for name in known if name.split(".")[0] == logger]
    before = [(log, log.handlers, log.propagate) for log in logs]
    for log in logs:
        log.handlers, log.propagate = [_Keeper(doubts)], False
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            yield
        doubts += [str(one.message) for one in warned if issubclass(one.category, UserWarning)]
        if serious := [text for text in doubts if not text.startswith(harmless)]:
            raise ValueError(serious[0])
    except DataError:
        raise
    except Exception as error:
        raise DataError(f"{path}: cannot be read as a {format_name} file: {reason(error)}") from None
    finally:
        for log, handlers, propagate in before:
            log.handlers, log.propagate = handlers, propagate


class _Keeper(logging.Handler):
    """Handler that keeps log records."""

    def __init__(self, kept: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._kept = kept

    def emit(self, record: logging.LogRecord) -> None:
        self._kept.append(record.getMessage())
