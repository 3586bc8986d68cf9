"""Run a sweep in parallel; it can be killed and resumed at any time without losing or repeating a case."""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import closing
from multiprocessing import parent_process
from typing import Any, TypeVar

from deatwin.plant.errors import DataError
from deatwin.plant.interrupts import obey
from deatwin.plant.words import first_of
from deatwin.studies.interrupts import forward_signals
from deatwin.studies.sweep.store import CaseStore
from deatwin.studies.voice import TimeLeft

Case = TypeVar("Case")
Tell = Callable[[float, str], None]

WATCH = 0.5  # Interval at which a worker checks that its master still lives, s
MOST_DEATHS = 4  # Deaths of its worker after which a case is given up
TOGETHER = 2  # Deaths after which a case runs alone, so that no other case dies with it
DEATHS = frozenset({"BrokenProcessPool", "BrokenExecutor", "KilledWorker"})
"""Names of errors of loky and dask that report the death of a worker; names, because dask may not be installed."""


def run_sweep(
    work: Callable[[Case], Mapping[str, Any]],
    cases: Mapping[str, Case],
    store: CaseStore,
    *,
    jobs: int | None = None,
    tell: Tell = lambda share, text: None,
    noun: str = "case",
    efforts: Mapping[str, float] | None = None,
) -> None:
    """Run every case that has no result yet."""
    with store.exclusive_lock():
        progress = _Progress(cases, store.missing(list(cases)), tell, noun, efforts or {})
        try:
            _run_all(work, cases, store, jobs, progress)
        except KeyboardInterrupt:
            through = len(cases) - len(store.missing(list(cases)))
            raise KeyboardInterrupt(
                f"interrupted: {through} of {len(cases)} {noun}s are finished and stay in {store.cases}; the same call "
                f"continues with the others"
            ) from None


def _run_all(
    work: Callable[[Case], Mapping[str, Any]],
    cases: Mapping[str, Case],
    store: CaseStore,
    jobs: int | None,
    progress: _Progress,
) -> None:
    """Run all missing cases, in turns; after a worker's death, the cases that were running are delayed."""
    from joblib import Parallel, delayed

    deaths: Counter[str] = Counter()
    while missing := store.missing(list(cases)):
        progress.only(missing)
        fewest = min(deaths[name] for name in missing)
        if fewest >= MOST_DEATHS:
            raise DataError(
                f"{store.cases}: the worker died each of {fewest} times that it ran {first_of(missing, 5)} (memory?); all "
                "other cases are finished"
            )
        turn = [name for name in missing if deaths[name] == fewest]
        turn = turn[:1] if fewest >= TOGETHER else turn
        try:
            tasks = (delayed(_one)(work, store, name, cases[name]) for name in turn)
            with closing(Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)) as finished:
                for name in finished:
                    progress.through(name)
        except Exception as error:
            if not any(kind.__name__ in DEATHS for kind in type(error).__mro__):
                raise
            deaths.update(store.left_running() or turn)
        else:
            if absent := store.missing(turn):
                raise DataError(
                    f"{store.cases}: there is no result of {first_of(absent, 5)}, although it was run: do all workers see "
                    f"this folder?"
                )
    progress.only([])


def _one(work: Callable[[Case], Mapping[str, Any]], store: CaseStore, name: str, case: Case) -> str:
    """Run a case with one BLAS thread: workers must not fight for the cores, nor round differently."""
    from threadpoolctl import threadpool_limits

    _end_with_master()
    if not store.has(name):  # dask repeats cases that were lost with a worker, including those already written
        with store.running(name), threadpool_limits(1), forward_signals():
            result = work(case)
            obey()
            store.put(name, result)
    return name


_watched = threading.Lock()


def _end_with_master() -> None:
    """End this worker soon after its master was killed, so that it does not compete with a new run."""
    master = parent_process()
    if os.name == "nt" or master is None or not _watched.acquire(blocking=False):
        return

    def watch() -> None:
        while os.getppid() == master.pid:  # at once false if the master was killed while this worker started
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="deatwin-master-watch").start()


class _Progress:
    """Progress of a sweep: share of the effort, number of cases, and remaining time."""

    def __init__(
        self, cases: Mapping[str, Any], missing: list[str], tell: Tell, noun: str, efforts: Mapping[str, float]
    ) -> None:
        self.tell, self.noun, self.efforts = tell, noun, efforts
        self.count, self.total = len(cases), sum(efforts.get(name, 1.0) for name in cases)
        self.left = {name: efforts.get(name, 1.0) for name in missing}
        self.todo = self.to_come = sum(self.left.values())
        self.time_left = TimeLeft()
        self.time_left.tell(0.0)
        if cases:
            tell(1.0 - self.todo / self.total, f"{noun} {self.count - len(missing)} of {self.count}")

    def only(self, missing: list[str]) -> None:
        """Count as finished all cases except the missing ones, because messages may be lost with a worker."""
        for name in self.left.keys() - set(missing):
            self.through(name)

    def through(self, name: str) -> None:
        self.to_come -= self.left.pop(name, 0.0)
        self.time_left.tell(1.0 - self.to_come / self.todo if self.todo else 1.0)
        done = f"{self.noun} {self.count - len(self.left)} of {self.count}"
        text = ", ".join(filter(None, (done, self.time_left.text)))
        self.tell(1.0 - self.to_come / self.total, text)
