"""Progress of a part of some work, as a share of the whole."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Progress", "part"]

Progress = Callable[[float], None]


def part(progress: Progress | None, first: float, last: float) -> Progress | None:
    """Progress of a part.

    Parameters
    ----------
    progress : callable or None
        Of the whole.
    first, last : float
        Shares of the whole at which the part begins and ends.

    Returns
    -------
    callable or None
    """
    if progress is None:
        return None
    return lambda share: progress(first + (last - first) * share)
