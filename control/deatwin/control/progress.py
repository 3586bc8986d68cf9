"""Report the progress of a part of some work as a share of the whole."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]


def part(progress: Progress | None, first: float, last: float) -> Progress | None:
    """Return a progress function for a part of the work."""
    if progress is None:
        return None
    return lambda share: progress(first + (last - first) * share)
