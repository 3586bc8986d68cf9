"""How benchmarks take a time: the shortest of a few runs."""

from __future__ import annotations

import time
from collections.abc import Callable


def timed(work: Callable[[], object], repeats: int = 5, clock: Callable[[], float] = time.process_time) -> float:
    """Shortest time of a few runs, s, of the processor unless another clock is given."""
    times = []
    for _ in range(repeats):
        begin = clock()
        work()
        times.append(clock() - begin)
    return min(times)
