"""Divide a recording where the command changes its kind, so that each kind is both fitted and held out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from deatwin.plant.recording import Experiment, Recording

WINDOWS = 60
"""Number of windows of equal length in which the speed of the command is compared."""
FEWEST = 10
"""Smallest number of windows in a section; the limit of Pettitt's test is accurate from about so many."""
LEVEL = 1e-3
"""Level of Pettitt's test. A division by chance does no harm: it only moves the held-out samples."""


def in_sections(experiment: Experiment) -> Experiment:
    """Return an experiment whose recordings are divided where the command changes its kind, as from noise to steps."""
    return replace(
        experiment, recordings=tuple(section for record in experiment.recordings for section in _sections(record))
    )


def _sections(record: Recording) -> Iterator[Recording]:
    """Yield the sections of a recording, on one clock."""
    length = (record.n_samples - 1) // WINDOWS
    steps = np.abs(np.diff(record.inputs[0]))[: WINDOWS * length]
    speeds = np.median(steps.reshape(WINDOWS, length), axis=1) if length else np.zeros(0)
    ends = [length * change for change in changes(speeds)]
    for first, last in zip([0, *ends], [*ends, record.n_samples], strict=True):
        yield record.section(first, last)


def changes(values: np.ndarray) -> list[int]:
    """Return the indices at which the distribution of `values`, shape (n,), changes, by Pettitt's test for each part.

    Source: A. N. Pettitt, A non-parametric approach to the change-point problem, Applied Statistics 28 (1979) 126-135.
    """
    from scipy.stats import rankdata  # takes half a second to import

    n = values.size
    if n < 2 * FEWEST:
        return []
    first = np.arange(1, n)
    statistic = np.abs(2 * np.cumsum(rankdata(values))[:-1] - first * (n + 1))
    if 2 * np.exp(-6 * statistic.max() ** 2 / (n**3 + n**2)) > LEVEL:
        return []
    change = FEWEST + int(np.argmax(statistic[FEWEST - 1 : n - FEWEST]))
    return [*changes(values[:change]), change, *(change + later for later in changes(values[change:]))]
