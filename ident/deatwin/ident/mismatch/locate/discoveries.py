"""Many tests at once."""

from __future__ import annotations

import numpy as np

FALSE_DISCOVERIES = 0.05


def discoveries(p_values: np.ndarray) -> np.ndarray:
    """Return which hypotheses, (n,), are rejected so that 5 % of the rejections are expected to be false."""
    from scipy.stats import false_discovery_control

    return np.asarray(false_discovery_control(p_values) <= FALSE_DISCOVERIES)
