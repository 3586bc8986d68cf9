"""Many tests at once."""

from __future__ import annotations

import numpy as np

FALSE_DISCOVERIES = 0.05


def discoveries(p_values: np.ndarray) -> np.ndarray:
    """Return which hypotheses, (n,), are rejected so that 5 % of the rejections are expected to be false."""
    # Benjamini & Hochberg, J. R. Stat. Soc. B 57 (1995) 289, doi:10.1111/j.2517-6161.1995.tb02031.x.
    order = np.argsort(p_values)
    limits = FALSE_DISCOVERIES * np.arange(1, p_values.size + 1) / p_values.size
    below = np.flatnonzero(p_values[order] <= limits)
    rejected = np.zeros(p_values.size, dtype=bool)
    if below.size:
        rejected[order[: below[-1] + 1]] = True
    return rejected
