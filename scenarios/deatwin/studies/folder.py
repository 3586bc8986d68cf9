"""A result folder that keeps a list of the files written into it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

from numpy.typing import ArrayLike

from deatwin.plant.errors import DataError
from deatwin.plant.files import write_csv, write_text_atomic
from deatwin.plant.files.formats.xlsx import split_sheet
from deatwin.plant.files.replacing import place_of


class ResultFolder:
    """A folder in which files appear complete or not at all."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.written: list[str] = []
        self._made: list[Path] = []
        self._make(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if kind is not None:
            for path in reversed(self._made):  # folders that were created here, innermost first
                with suppress(OSError):  # the folder is not empty, or is gone
                    path.rmdir()

    def text(self, name: str, text: str) -> None:
        """Write a text file."""
        self.save(name, lambda path: write_text_atomic(path, text))

    def csv(self, name: str, columns: Mapping[str, ArrayLike]) -> None:
        """Write a table."""
        self.save(name, lambda path: write_csv(path, columns))

    def save(self, name: str, write: Callable[[Path], None]) -> None:
        """Let an object write its own file."""
        target = self.path / name
        self._make(target.parent)
        write(target)
        self.written.append(name)

    def remove_former(self, pattern: str) -> None:
        """Remove files of an earlier run, listed in its ``run.json``, that this run has not written."""
        try:
            former = json.loads((self.path / "run.json").read_text(encoding="utf-8"))["outputs"]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return
        for name in former if isinstance(former, list) else []:
            if re.fullmatch(pattern, str(name)) and name not in self.written:
                with suppress(OSError, ValueError):  # not a file name, so this version has not written it
                    (self.path / name).unlink(missing_ok=True)

    @property
    def summary(self) -> str:
        """List the written files, in words."""
        return f"{self.path} holds {', '.join(self.written)}" if self.written else f"nothing was written to {self.path}"

    def _make(self, path: Path) -> None:
        if str(path) == "-":
            raise DataError("-: results are not written to standard output; give a folder for the results")
        if path.is_file():
            raise DataError(f"{path}: this is a file; give a folder for the results")
        try:
            absent = [folder for folder in (path, *path.parents) if not folder.exists()]
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"{path}: the folder cannot be made: {error.strerror}") from None
        self._made.extend(reversed(absent))
        _require_writable(path)


def require_place(file: Path | str, inputs: Iterable[Path | str]) -> None:
    """Raise DataError unless a file can be written; called before work begins."""
    path = place_of(file)
    if not path.parent.is_dir():
        raise DataError(f'{path}: the folder "{path.parent}" does not exist; make it, or choose another')
    require_unread(path, inputs)
    _require_writable(path.parent)


def require_unread(file: Path, inputs: Iterable[Path | str]) -> None:
    """Raise DataError if an output file is also an input file."""
    if file.exists() and any(p.is_file() and file.samefile(p) for p in (Path(split_sheet(i)[0]) for i in inputs)):
        raise DataError(
            f"{file}: this file is an input of this command and would be overwritten; choose another name or folder for the result"
        )


def _require_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
        raise DataError(f"{folder}: you may not write into this folder; choose another, or change its permissions")
