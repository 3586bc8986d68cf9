"""Diagnoses and plans that run in separate processes, which can be stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import IO, Any

from deatwin.app.live.desk import inside, safe_name
from deatwin.plant.errors import DataError
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.studies.partial import holds_only_partial

WORKER = (sys.executable, "-m", "deatwin.app.live.worker")
"""Command that runs a job; the arguments of ``deatwin`` follow."""
MOST_RUNNING = 2
GRACE = 5.0  # Seconds that a process has to stop by itself
LONGEST_LINE = 100_000
LAST_LINES = 50


class State(Enum):
    """State of a job; each value is the word for it."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, kw_only=True)
class Order:
    """Request for a diagnosis, or for a plan, which shows which missing physics an input would reveal."""

    command: str  # ``diagnose`` or ``plan``
    rig: str  # Rig file or ``model.json`` in the folder
    recordings: Sequence[
        str
    ]  # Files in the folder: one experiment, or for a plan the input, if none is to be suggested
    out: str  # Name of a new folder for the results, or of one with only the files of an interrupted diagnosis
    reading: ReadOptions = NO_OPTIONS
    seed: int = 0

    @property
    def files(self) -> tuple[str, ...]:
        """Files that are read from the folder, the rig first."""
        return (self.rig, *self.recordings)

    @property
    def arguments(self) -> list[str]:
        """Arguments for ``deatwin``, which runs in the folder."""
        files = [f"./{name}" if name.startswith("-") else name for name in self.files]
        reading = self.reading.without("output_column", "allow_gaps") if self.command == "plan" else self.reading
        return [self.command, *files, "--out", self.out, "--seed", str(self.seed), *map("=".join, reading.flags)]

    def require(self) -> None:
        """Raise DataError if a choice is missing."""
        if self.command == "diagnose" and not (self.recordings and self.rig):
            raise DataError("choose a rig file and at least one recording")
        if not self.rig:
            raise DataError("choose a rig file")


class Job:
    """A diagnosis or a plan in progress."""

    def __init__(self, root: Path, order: Order, program: Sequence[str] = WORKER) -> None:
        self.order = order
        self.share = 0.0
        self.steps: list[tuple[str, float]] = []
        """Steps so far, each with its beginning in seconds from the start."""
        self.sentence = ""
        """Verdict, or reason of the failure."""
        self.state = State.RUNNING
        self._root = root
        self._started = time.monotonic()
        self._ended: float | None = None
        self._cancelled = False
        self._complaints: deque[str] = deque(maxlen=LAST_LINES)
        self._process = subprocess.Popen(
            [*program, *order.arguments],
            cwd=root,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "PYTHONSAFEPATH": "1", "PYTHONIOENCODING": "utf-8"},  # no imports from the folder
            **_apart(),
        )
        self._watch = threading.Thread(target=self._follow, daemon=True)
        self._watch.start()

    @property
    def seconds(self) -> float:
        """Time from the start to the end or to now, s."""
        return (self._ended or time.monotonic()) - self._started

    @property
    def seconds_left(self) -> float | None:
        """Estimated remaining time from the completed share; None before there is an estimate."""
        known = self.state is State.RUNNING and 0.05 < self.share < 1.0
        return self.seconds * (1 - self.share) / self.share if known else None

    def cancel(self) -> None:
        """Ask the process to stop; it is killed if it does not."""
        if self.state is State.RUNNING and not self._cancelled:
            self._cancelled = True
            _interrupt(self._process)
            timer = threading.Timer(GRACE, self._end_if_running)
            timer.daemon = True
            timer.start()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the process has ended and its output is read."""
        self._watch.join(timeout)

    def end(self) -> None:
        """Kill the process and all its children at once."""
        self._cancelled = True
        self._end_if_running()
        self.wait(GRACE)

    def _end_if_running(self) -> None:
        if self.state is State.RUNNING:  # until it has ended, its number is given to no other process
            _end(self._process)

    def _follow(self) -> None:
        """Read the output of the process until it ends."""
        errors = threading.Thread(target=self._listen, daemon=True)
        errors.start()
        for line in _lines(self._process.stdout):
            self._hear(line)
        errors.join()
        status = self._process.wait()
        self._ended = time.monotonic()
        if status == 0:
            self.share, state = 1.0, State.DONE
        else:
            state = State.CANCELLED if self._cancelled else State.FAILED
            self.sentence = "" if self._cancelled else self._complaint(status)
            with suppress(OSError):  # the folder holds files
                (self._root / self.order.out).rmdir()
        self.state = state

    def _listen(self) -> None:
        self._complaints.extend(line for line in map(str.strip, _lines(self._process.stderr)) if line)

    def _hear(self, line: str) -> None:
        """Process one line from the worker; lines of other programs are ignored."""
        try:
            facts: Any = json.loads(line)
            share, step = float(facts["share"]), str(facts.get("step", ""))
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            return
        self.share = min(max(share, self.share), 1.0)
        step = step.partition(" (")[0]  # brackets contain how much of it is done
        if step and share < 1.0 and (not self.steps or self.steps[-1][0] != step):
            self.steps.append((step, self.seconds))
        if "sentence" in facts:
            self.sentence = f"{facts.get('verdict', '')}: {facts['sentence']}"

    def _complaint(self, status: int) -> str:
        """Return the line that states the error."""
        said = [line.removeprefix("error: ") for line in self._complaints if line.startswith("error: ")]
        last = said or list(self._complaints)
        return last[-1] if last else f"the process ended with status {status} and printed no message"


class Board:
    """The jobs of one live view, newest first."""

    def __init__(self, root: Path, program: Sequence[str] = WORKER) -> None:
        self.root = root
        self.program = program
        self.jobs: list[Job] = []

    @property
    def running(self) -> list[Job]:
        """Jobs that have not ended."""
        return [job for job in self.jobs if job.state is State.RUNNING]

    def start(self, order: Order) -> Job:
        """Start a job."""
        order.require()
        for name in order.files:
            if not inside(self.root, name).is_file():
                raise DataError(f"{name}: there is no such file in the folder")
        if safe_name(order.out) != order.out:
            raise DataError(
                f'{order.out}: not a valid name for a folder here; use for example "{safe_name(order.out)}"'
            )
        if len(self.running) >= MOST_RUNNING:
            raise DataError(f"{MOST_RUNNING} jobs are running; wait until one ends, or cancel one")
        self._make(order.out)
        job = Job(self.root, order, self.program)
        self.jobs.insert(0, job)
        return job

    def _make(self, out: str) -> None:
        """Create the folder for results, or reuse one that holds only the steps of a cancelled run."""
        folder = self.root / out
        try:
            folder.mkdir()
        except FileExistsError:
            if any(_same(folder, self.root / job.order.out) for job in self.running):
                raise DataError(f"{out}: a running job writes into it; choose another name") from None
            if not holds_only_partial(folder):
                raise DataError(
                    f"{out}: this name is already taken, and results are not replaced; choose another name"
                ) from None
        except OSError as error:
            raise DataError(f"{out}: the folder cannot be made: {error.strerror}") from None

    def close(self) -> None:
        """End all running jobs."""
        for job in self.running:
            job.end()


def _lines(pipe: IO[str] | None) -> Iterator[str]:
    """Read a pipe line by line; very long lines are cut."""
    if pipe is not None:
        with pipe:
            yield from iter(lambda: pipe.readline(LONGEST_LINE), "")


def _same(one: Path, other: Path) -> bool:
    """Return whether two names mean the same folder; some systems ignore capitals."""
    try:
        return one.samefile(other)
    except OSError:
        return False


if sys.platform == "win32":

    def _apart() -> dict[str, Any]:
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}

    def _interrupt(process: subprocess.Popen[str]) -> None:
        process.send_signal(signal.CTRL_BREAK_EVENT)

    def _end(process: subprocess.Popen[str]) -> None:
        process.kill()

else:

    def _apart() -> dict[str, Any]:
        """Arguments that put a process and all that it starts into a group of their own."""
        return {"start_new_session": True}

    def _interrupt(process: subprocess.Popen[str]) -> None:
        _send(process, signal.SIGINT)

    def _end(process: subprocess.Popen[str]) -> None:
        _send(process, signal.SIGKILL)

    def _send(process: subprocess.Popen[str], number: int) -> None:
        """Send a signal to the whole group, whether or not its first process is still there."""
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
