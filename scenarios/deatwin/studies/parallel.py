"""Run independent jobs of a scenario with progress reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from deatwin.ident.parallel import run_jobs
from deatwin.studies.voice import Progress

Result = TypeVar("Result")


def between(progress: Progress, first: float, last: float) -> Progress:
    """Report the progress of a part of the work, which runs from the share `first` to `last` of the whole."""

    def tell(share: float, text: str = "") -> None:
        progress(first + (last - first) * share, text)

    return tell


def run_told(
    function: Callable[..., Result], tasks: Iterable[tuple[object, ...]], jobs: int, progress: Progress, doing: str
) -> list[Result]:
    """Call a function once per tuple of arguments; return results in order."""
    every = list(tasks)
    progress(0.0, doing)
    return run_jobs(function, every, workers=jobs, finished=lambda count: progress(count / len(every), doing))
