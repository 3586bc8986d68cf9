"""Random processes whose law is known."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from deatwin.ident.mismatch.likelihood.model import Process


def drawn(process: Process, count: int, step: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """So many samples of a sum of first-order processes, which begins as it goes on."""
    found = np.zeros(count)
    for weight, time in zip(process.weights, process.times, strict=True):
        keep = np.exp(-step / time)
        kicks = rng.standard_normal(count) * np.sqrt(np.where(np.arange(count) > 0, 1.0 - keep**2, 1.0))
        found += np.sqrt(weight) * lfilter([1.0], [1.0, -keep], kicks)
    return found
