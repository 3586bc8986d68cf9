"""Many tests at once."""

from __future__ import annotations

import numpy as np

from deatwin.ident.mismatch.thresholds import CHANCE


def discoveries(p_values: np.ndarray) -> np.ndarray:
    """Return which hypotheses, (n,), are rejected so that 5 % of the rejections are expected to be false."""
    from scipy.stats import false_discovery_control

    # Benjamini & Hochberg, J. R. Stat. Soc. B 57 (1995) 289, doi:10.1111/j.2517-6161.1995.tb02031.x.
    # Readings without any noise may leave a test without a value: it shows nothing.
    return np.asarray(false_discovery_control(np.clip(np.nan_to_num(p_values, nan=1.0), 0.0, 1.0)) <= CHANCE)
