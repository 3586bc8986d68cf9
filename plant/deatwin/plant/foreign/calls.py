"""Call a foreign model in separate processes, so that a crash costs one call, and remember the answers."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.plant.arrays import Array, real_numbers
from deatwin.plant.interrupts import ignore_interrupts, interrupts_held
from deatwin.plant.safe_read import clipped

Model = Callable[[Mapping[str, Any], Mapping[str, Array], Array], Any]  # ``f(parameters, inputs, time) -> readings``

KEPT = 512
"""Number of answers that a process remembers: enough for all derivatives about a few points. With 1e5 samples each,
they take 0.4 GB."""
CRASHED, TOO_LONG = "its process crashed", "it took too long"
LOST = (CRASHED, TOO_LONG)  # Faults that another call at the same time may have caused


@dataclass(frozen=True, kw_only=True, eq=False)
class Call:
    """Arguments of a foreign model: numbers, or arrays of shape (n,), by name; `time` (n,)."""

    parameters: Mapping[str, float | Array]
    inputs: Mapping[str, Array]
    time: Array
    output: str

    def digest(self) -> bytes:
        """Key of the content."""
        found = hashlib.sha256(self.output.encode())
        for name, value in (*self.parameters.items(), *self.inputs.items(), ("", self.time)):
            found.update(name.encode() + b"\0" + np.ascontiguousarray(value, dtype=float).tobytes())
        return found.digest()


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """Readings of a foreign model, shape (n,), or the fault that left none."""

    readings: Array | None = None
    fault: str = ""


_REMEMBERED: OrderedDict[tuple[Any, bytes], Answer] = OrderedDict()  # The latest answers, by model and call


def answers(model: Model, calls: Sequence[Call], longest: float = np.inf) -> list[Answer]:
    """Return answers of a model, if possible from worker processes, where each may take `longest` seconds."""
    keys = [(model, call.digest()) for call in calls]
    found = {key: _REMEMBERED[key] for key in keys if key in _REMEMBERED}
    for key in found:
        _REMEMBERED.move_to_end(key)
    new = {key: call for key, call in zip(keys, calls, strict=True) if key not in found}
    for key, answer in zip(new, _called(model, list(new.values()), longest), strict=True):
        found[key] = _REMEMBERED[key] = answer
        if len(_REMEMBERED) > KEPT:
            _REMEMBERED.popitem(last=False)
    return [found[key] for key in keys]


def _called(model: Model, calls: Sequence[Call], longest: float) -> list[Answer]:
    workers = _workers_for(model) if calls else None
    if workers is None:
        return [_answer(model, call) for call in calls]
    return workers.answers(model, calls, longest)


def _answer(model: Model, call: Call) -> Answer:
    """Call a model once; any exception of it becomes one line."""
    try:
        # Copies, so that a model that writes into its arguments does not affect the next call.
        given = model(
            dict(call.parameters), {name: np.array(u) for name, u in call.inputs.items()}, np.array(call.time)
        )
        chosen = given[call.output] if isinstance(given, Mapping) else given
        readings = np.array(real_numbers(chosen, "its readings"))
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        said = f": {clipped(lines[-1], 160)}" if lines else ""
        return Answer(fault=f"it raised {type(error).__name__}{said}")
    readings = readings[0] if readings.shape == (1, call.time.size) else readings
    if readings.shape != call.time.shape:
        return Answer(fault=f"it returned readings of shape {readings.shape} for times of shape {call.time.shape}")
    if not np.isfinite(readings).all():
        at = call.time[int(np.argmin(np.isfinite(readings)))]
        return Answer(fault=f"its reading at {at:.6g} s is not a finite number")
    return Answer(readings=readings)


class _Workers:
    """Worker processes that call models."""

    def __init__(self, count: int) -> None:
        self._count, self._pool = count, _pool(count)
        self._taken: dict[Model, bool] = {}

    def take(self, model: Model) -> bool:
        """Return whether the processes can load a model: it can be pickled, and they find its module."""
        if model not in self._taken:
            try:
                self._taken[model] = bool(self._submitted(callable, model).result())
            except Exception:  # unpickling may raise anything, or crash the process
                self._taken[model] = False
        return self._taken[model]

    def answers(self, model: Model, calls: Sequence[Call], longest: float) -> list[Answer]:
        """Return answers in order; after a crash or timeout, each missing one is tried alone."""
        futures = [self._submitted(_answer, model, call) for call in calls]
        found = [self._result(future, longest) for future in futures]
        return [
            self._result(self._submitted(_answer, model, call), longest) if a.fault in LOST else a
            for a, call in zip(found, calls, strict=True)
        ]

    def _submitted(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return self._pool.submit(function, *arguments)
        except (BrokenExecutor, RuntimeError):  # the pool broke, or was shut down
            self._pool = _pool(self._count)
            return self._pool.submit(function, *arguments)

    def _result(self, future: Any, longest: float) -> Answer:
        try:
            answer: Answer = future.result(None if np.isinf(longest) else longest)
        except TimeoutError:
            self._pool.shutdown(kill_workers=True)
            return Answer(fault=TOO_LONG)
        except (BrokenExecutor, CancelledError):
            return Answer(fault=CRASHED)
        return answer


def _pool(count: int) -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    pool = ProcessPoolExecutor(max_workers=count, env=one_thread, initializer=ignore_interrupts)
    with interrupts_held():
        started = pool.submit(abs, 0)
    started.result()  # the time to start a process does not count as part of a call
    return pool


_WORKERS: dict[int, _Workers] = {}


def _workers_for(model: Model) -> _Workers | None:
    """Return this process's workers; None if the model cannot be sent to another process."""
    if os.getpid() not in _WORKERS:  # a forked process has none of its parent's workers
        _WORKERS[os.getpid()] = _Workers(_count())
    workers = _WORKERS[os.getpid()]
    return workers if workers.take(model) else None


def _count() -> int:
    """Return the number of workers: one inside a study's worker, whose cores are busy already, else one per core."""
    from joblib import cpu_count

    return 1 if multiprocessing.parent_process() is not None else int(cpu_count())
