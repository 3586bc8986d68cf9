"""Description of a scenario and its settings. It is loaded without numerical packages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deatwin.studies.voice import Progress

if TYPE_CHECKING:
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.provenance import RunRecord


DATA_VARIABLE = "DEATWIN_DATA"  # Environment variable that names the folder of public recordings


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """Settings of a run of a story."""

    folder: ResultFolder
    data: Path | None  # Folder of public recordings
    command: Sequence[str]
    jobs: int
    seed: int
    progress: Progress  # Called with the completed share and the current work
    size: str | None = None  # One of the story's sizes; None for its usual one
    tasks: Sequence[str] = ()  # Tasks of the story to run; all if empty

    def record(self, inputs: Sequence[dict[str, str]] = ()) -> RunRecord:
        """Start the record of the run."""
        from deatwin.studies.provenance import RunRecord

        return RunRecord(command=self.command, inputs=list(inputs), seed=self.seed, jobs=self.jobs)


@dataclass(frozen=True, kw_only=True)
class Story:
    """An entry of the list of stories."""

    name: str
    line: str  # Subject of the story
    minutes: float  # Approximate time on two cores
    module: str  # Module with a function ``run(setting)`` that returns plain data with a ``sentence``
    sizes: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()  # Parts that can be run alone
    times: tuple[float, ...] = ()  # Approximate minutes of each size on two cores
    resumes: bool = False

    @property
    def told(self) -> str:
        """Description, times of the sizes, and whether the scenario resumes."""
        sizes = ", ".join(f"{size} {_in_words(time)}" for size, time in zip(self.sizes, self.times, strict=True))
        about = "; ".join(text for text in (sizes, "resumes" if self.resumes else "") if text)
        return f"{self.line} ({about})" if about else self.line

    def require_size(self, size: str | None) -> None:
        """Raise DataError unless the story has that size."""
        if size is not None:
            self._require("size", size, self.sizes)

    def require_tasks(self, tasks: Sequence[str]) -> None:
        """Raise DataError unless the story has these tasks."""
        for task in tasks:
            self._require("task", task, self.tasks)

    def _require(self, kind: str, given: str, known: tuple[str, ...]) -> None:
        from deatwin.plant.errors import DataError, nearest

        if given not in known:
            choice = f"known: {', '.join(known)}" if known else f"it has one {kind}: leave --{kind} out"
            raise DataError(f"the scenario {self.name} has no {kind} {given!r}{nearest(given, known)} ({choice})")

    @property
    def run(self) -> Callable[[Setting], Mapping[str, Any]]:
        """Return the function that runs the scenario."""
        function: Callable[[Setting], Mapping[str, Any]] = import_module(self.module).run
        return function


def _in_words(minutes: float) -> str:
    return f"{minutes / 60:g} h" if minutes >= 90 else f"{minutes:g} min"
