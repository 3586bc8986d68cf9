"""How benchmarks take a time: the shortest of a few runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def best(
    work: Callable[[], Any], repeats: int = 5, clock: Callable[[], float] = time.process_time
) -> tuple[float, Any]:
    """Shortest time of a few runs, s, of the processor unless another clock is given, and the last result."""
    times, result = [], None
    for _ in range(repeats):
        begin = clock()
        result = work()
        times.append(clock() - begin)
    return min(times), result


def timed(work: Callable[[], object], repeats: int = 5, clock: Callable[[], float] = time.process_time) -> float:
    """The time alone."""
    return best(work, repeats, clock)[0]
