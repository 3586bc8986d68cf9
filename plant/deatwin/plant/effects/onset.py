"""Where a residual steps: starting points for effects that set in at a time."""

from __future__ import annotations

import numpy as np

__all__ = ["LATEST", "steps_of"]

LATEST = 3e4
"""Latest time of an event on the clock of the recordings, s: a day in the laboratory."""
APART = 0.02
"""Share of the samples by which two candidates differ at least."""


def steps_of(timepts: np.ndarray, residual: np.ndarray, count: int = 3) -> tuple[tuple[float, float], ...]:
    r"""Times at which one step would explain most of a residual, best first.

    A step after sample k takes :math:`n_1n_2(\bar r_2 - \bar r_1)^2/n` off the sum of squares. The measure has no
    scale, so nothing is to be tuned to the noise.

    Parameters
    ----------
    timepts : ndarray, shape (n,)
        Clock times, ascending, s.
    residual : ndarray, shape (n,)
        Any unit.
    count : int
        At most so many.

    Returns
    -------
    tuple of (time, height)
        s, halfway between two samples, and the step's height in the unit of the residual; only local maxima of
        the measure, at times that an event may have, none where there are fewer than two samples or none that steps.

    References
    ----------
    Hinkley, Biometrika 57 (1970) 1, doi:10.1093/biomet/57.1.1.
    """
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
        if _peaks_at(explained, k) and all(abs(k - other) > apart for other in found):
            found.append(int(k))
    steps = ((float(timepts[k] + timepts[k + 1]) / 2, float(heights[k])) for k in found)
    return tuple((time, height) for time, height in steps if 0.0 < time < LATEST)


def _peaks_at(values: np.ndarray, k: int) -> bool:
    return bool(values[k] >= values[max(k - 1, 0) : k + 2].max())
