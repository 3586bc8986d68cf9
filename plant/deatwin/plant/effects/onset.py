"""Find steps of a residual, as starting points for effects that begin at a certain time."""

from __future__ import annotations

import numpy as np

LATEST = 3e4  # Latest time of an event on the clock of the recordings, s: a day in the laboratory
APART = 0.02  # Least distance between two candidates, as a share of the number of samples


def steps_of(
    timepts: np.ndarray, residual: np.ndarray, count: int = 3, latest: float = LATEST
) -> tuple[tuple[float, float], ...]:
    """Return times of steps that would explain most of a residual (n,) (Hinkley, Biometrika 57 (1970) 1)."""
    n = residual.size
    if n < 2:
        return ()
    before = np.arange(1, n)
    sums = np.cumsum(residual)[:-1]
    heights = (residual.sum() - sums) / (n - before) - sums / before
    explained = before * (n - before) / n * heights**2
    found: list[int] = []
    apart = max(APART * n, 1.0)
    for k in np.argsort(-explained, kind="stable"):
        if len(found) == count or explained[k] <= 0.0:
            break
        is_peak = explained[k] >= explained[max(k - 1, 0) : k + 2].max()
        if is_peak and all(abs(k - other) > apart for other in found):
            found.append(int(k))
    steps = ((float(timepts[k] + timepts[k + 1]) / 2, float(heights[k])) for k in found)
    return tuple((time, height) for time, height in steps if 0.0 < time < latest)
