"""Run independent jobs: one random generator per job, one BLAS thread per worker, results in order."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from functools import wraps
from multiprocessing import active_children, current_process
from typing import Any, ParamSpec, TypeVar

import numpy as np

from deatwin.ident.arguments import whole_number
from deatwin.plant.arrays import require_seed
from deatwin.plant.errors import ModelError
from deatwin.plant.interrupts import ignore_interrupts, interrupts_held

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")
PARENT = os.getppid()  # Parent process; of a worker, the one that wants its results


def one_thread(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function that takes one BLAS thread, because more compete with other workers and round differently."""

    @wraps(function)
    def in_one_thread(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            return function(*args, **kwargs)

    return in_one_thread


def spawn_generators(seed: int, count: int) -> list[np.random.Generator]:
    """Return independent random generators, one for each job; the same seed gives the same generators.

    Parameters
    ----------
    seed : int
        Seed of the whole study.
    count : int
        Number of generators.

    Raises
    ------
    ModelError
        If `seed` or `count` is not an integer of at least 0.
    """
    require_seed(seed)
    whole_number(count, "count", 0)
    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(count)]


def require_workers(workers: Any) -> None:
    """Raise ModelError for anything but a number of worker processes, or -1 for one on each core."""
    is_whole = isinstance(workers, int | np.integer) and not isinstance(workers, bool)
    if not is_whole or (workers < 1 and workers != -1):
        raise ModelError(f"{workers!r} worker processes: give an integer of at least 1, or -1 for all cores")


def run_jobs(
    function: Callable[..., Result],
    jobs: Iterable[tuple[Any, ...]],
    *,
    workers: int = 1,
    finished: Callable[[int], None] | None = None,
) -> list[Result]:
    """Call a function once for each tuple of arguments.

    Several processes are run by joblib, with the backend that the user has set by ``joblib.parallel_config``.

    Parameters
    ----------
    function : callable
        Function to call. Worker processes must be able to import the function by its name.
    jobs : iterable of tuple
        Arguments of each call.
    workers : int
        Number of processes; 1 runs in this process, -1 uses all cores.
    finished : callable, optional
        Called with the number of finished jobs after each one.

    Returns
    -------
    list
        Results in the order of `jobs`.
    """
    results: dict[int, Result] = {}
    for number, result in jobs_as_they_end(function, jobs, workers=workers):
        results[number] = result
        if finished is not None:
            finished(len(results))
    return [results[number] for number in sorted(results)]


def stream_jobs(
    function: Callable[..., Result], jobs: Iterable[tuple[Any, ...]], *, workers: int = 1
) -> Iterator[Result]:
    """Call a function once per tuple of arguments; yield the results in order, each as soon as possible."""
    ended: dict[int, Result] = {}
    following = 0
    with closing(jobs_as_they_end(function, jobs, workers=workers)) as running:
        for number, result in running:
            ended[number] = result
            while following in ended:
                yield ended.pop(following)
                following += 1


def jobs_as_they_end(
    function: Callable[..., Result], jobs: Iterable[tuple[Any, ...]], *, workers: int = 1
) -> Generator[tuple[int, Result], None, None]:
    """Call a function once per tuple of arguments; yield number and result of each call when it ends."""
    require_workers(workers)
    tasks = list(jobs)
    if workers == 1 or not tasks:
        for number, task in enumerate(tasks):
            yield number, one_thread(function)(*task)
        return
    from joblib import Parallel, delayed

    results: Any = None
    try:
        with interrupts_held():
            results = Parallel(n_jobs=workers, return_as="generator_unordered")(
                delayed(_in_worker)(number, function, task) for number, task in enumerate(tasks)
            )
        for result in results:  # noqa: UP028 - closing this generator must not warn of the jobs that were dropped
            yield result
    finally:
        if results is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                results.close()


def end_workers() -> None:
    """End worker processes that are idle or still starting, because a program would wait for them when it ends."""
    for worker in active_children():
        if worker.name.startswith("Loky"):  # joblib's workers; other pools end their own
            worker.terminate()
    pools = sys.modules.get("joblib.externals.loky.reusable_executor")
    if pool := getattr(pools, "_executor", None):  # its getter would first resize the executor, and wait
        pool.shutdown(wait=False)  # the next call gets another executor


def _in_worker(number: int, function: Callable[..., Result], task: tuple[Any, ...]) -> tuple[int, Result]:
    """Run a job unless the process that requested it was killed; waiting jobs would compete with a new run."""
    if current_process().name != "MainProcess":
        if os.getppid() != PARENT:
            os._exit(1)
        ignore_interrupts()
    return number, one_thread(function)(*task)
