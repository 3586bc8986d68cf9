"""What a command says: lines for people, JSON for machines, progress on the terminal."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

__all__ = ["Progress", "Voice", "complain"]

Progress = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class Voice:
    """How much a command says, and in which form.

    Parameters
    ----------
    as_json : bool
        The result goes to stdout as JSON and nothing else does.
    quiet : bool
        Neither lines nor progress.
    """

    as_json: bool = False
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.quiet:
            logging.getLogger("deatwin").setLevel(logging.ERROR)

    def say(self, text: str) -> None:
        """Print a line for people.

        Parameters
        ----------
        text : str
            The line; it is not broken.
        """
        if not (self.as_json or self.quiet):
            print(text)

    def result(self, data: Mapping[str, Any]) -> None:
        """Print the result for machines, if asked for.

        Parameters
        ----------
        data : mapping
            Plain data.
        """
        if self.as_json:
            print(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))

    @contextmanager
    def progress(self, title: str) -> Iterator[Progress]:
        """A bar on stderr with the time left, where stderr is a terminal.

        Parameters
        ----------
        title : str
            Shown until the first step names itself.

        Yields
        ------
        callable
            Takes the share that is done, from 0 to 1, and what is being done.
        """
        if self.quiet or not sys.stderr.isatty():
            yield lambda share, text="": None  # type: ignore[misc]
            return
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=1.0)
            yield lambda share, text="": bar.update(task, completed=share, description=text or title)  # type: ignore[misc]


def complain(text: str) -> None:
    """Print one error line.

    Parameters
    ----------
    text : str
        What was wrong, where, and what would be right.
    """
    print(f"error: {' '.join(text.split())}", file=sys.stderr)
