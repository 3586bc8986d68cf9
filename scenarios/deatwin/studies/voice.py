"""Output of commands: lines for people, JSON for programs, progress as a bar or, without a terminal, as lines."""

from __future__ import annotations

import json
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

_GROWTH = 1.25  # Largest ratio of an estimate to the one before, so that a reader who plans by it is not set back
_KNOWN = 0.05  # Share of the work after which its pace is known
_LONG = 120.0  # Time after which any pace is told, s: whoever has waited so long plans by a rough number
_KEPT = 5.0  # Least time between two increases of an estimate, s: on a terminal, each look would increase it


class TimeLeft:
    """An estimate of the remaining time, from the mean pace so far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._share = 0.0
        self._first: tuple[float, float] | None = None  # work done by an earlier run took none of this run's time
        self._told: tuple[float, float] | None = None  # time and value of the last estimate, s
        self._rises = False  # True while the work takes longer than was estimated last

    def tell(self, share: float) -> None:
        """Update with the completed share."""
        if self._first is None:
            self._first = (self._clock(), share)
        self._share = share

    @property
    def seconds(self) -> float | None:
        """Seconds left; None before the pace is known."""
        if self._first is None:
            return None
        now, (began, before) = self._clock(), self._first
        done = self._share - before
        if done <= 0.0 or (done < _KNOWN * (1.0 - before) and now - began < _LONG):
            return None
        estimate = (now - began) * (1.0 - self._share) / done
        told = (now, estimate) if self._told is None else self._told
        self._rises = estimate > told[1]
        if now - told[0] < _KEPT:
            self._told = (told[0], min(estimate, told[1]))
        else:
            self._told = (now, min(estimate, _GROWTH * told[1]))
        return self._told[1]

    @property
    def text(self) -> str:
        """The estimate in words; empty when nothing remains."""
        if self._share > 1.0 - 1e-9:  # sums of shares are rounded
            return ""
        seconds = self.seconds
        if seconds is None:
            return "unknown time left"
        return f"{'at least' if self._rises else 'about'} {duration_in_words(seconds)} left"


def duration_in_words(seconds: float) -> str:
    """Write a time in a suitable unit."""
    minutes = seconds / 60
    if minutes >= 180:
        return f"{minutes / 60:.0f} h"
    return f"{minutes:.0f} min" if minutes >= 1.5 else f"{max(seconds, 1):.0f} s"


Progress = Callable[[float, str], None]
EVERY = 30.0  # Interval of progress lines without a terminal, s


@dataclass(frozen=True, kw_only=True)
class Voice:
    """How much a command prints, and in which form."""

    as_json: bool = False  # True if only the result goes to stdout, as JSON
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.quiet:
            logging.getLogger("deatwin").setLevel(logging.ERROR)

    def say(self, text: str) -> None:
        """Print a line for people."""
        if not (self.as_json or self.quiet):
            print(text)

    def result(self, data: Mapping[str, Any]) -> None:
        """Print the result as JSON, if requested."""
        if self.as_json:
            plain = not (sys.stdout.encoding or "").lower().startswith("utf")
            print(json.dumps(data, indent=1, ensure_ascii=plain, allow_nan=False))

    @contextmanager
    def progress(self, title: str) -> Iterator[Progress]:
        """Show a bar on stderr with the remaining time; without a terminal, a plain line from time to time."""
        from deatwin.plant.interrupts import obey  # imports numpy, which help does not need

        with self._shown(title) as show:

            def tell(share: float, text: str = "") -> None:
                obey()
                show(share, text)

            yield tell

    @contextmanager
    def _shown(self, title: str) -> Iterator[Progress]:
        if self.quiet:
            yield lambda share, text: None
            return
        if not sys.stderr.isatty():
            with _lines(PlainProgress(title)) as plain:
                yield plain.tell
            return
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Bar

        left = TimeLeft()
        description, remaining = TextColumn("{task.description}"), TextColumn("{task.fields[left]}")
        columns = (description, BarColumn(), TaskProgressColumn(), remaining)
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=1.0, left=left.text)

            def show(share: float, text: str) -> None:
                left.tell(share)
                told = "" if text.endswith(" left") else left.text
                bar.update(task, completed=share, description=text or title, left=told)

            yield show


class PlainProgress:
    """Progress as lines, for files and pipes: current work, completed share, remaining time."""

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._title, self._left = title, TimeLeft(clock)
        self._share, self._doing = 0.0, title

    def tell(self, share: float, text: str = "") -> None:
        """Update with the completed share."""
        self._left.tell(share)
        self._share, self._doing = share, text or self._title

    @property
    def line(self) -> str:
        """One line, without control characters."""
        doing = "".join(c if c.isprintable() else " " for c in self._doing)
        parts = [" ".join(doing.split()), f"{100 * self._share:.0f} % done"]
        if not doing.endswith(" left"):  # a study knows better how long its cases take, and states it
            parts.append(self._left.text)
        return ", ".join(filter(None, parts))


def print_lines(progress: PlainProgress, wait: Callable[[float], bool]) -> None:
    """Print a line of progress on stderr repeatedly. `wait` waits a number of seconds."""
    while not wait(EVERY):
        with suppress(OSError, ValueError):  # nobody listens any more, but the work continues
            print(progress.line, file=sys.stderr, flush=True)


@contextmanager
def _lines(progress: PlainProgress) -> Iterator[PlainProgress]:
    """Print lines during the work, because one step of it may take long."""
    ended = threading.Event()
    printer = threading.Thread(target=print_lines, args=(progress, ended.wait), daemon=True, name="deatwin-progress")
    printer.start()
    try:
        yield progress
    finally:
        ended.set()
        printer.join()


def complain(text: str) -> None:
    """Print one error line."""
    print(f"error: {' '.join(text.split())}", file=sys.stderr)
