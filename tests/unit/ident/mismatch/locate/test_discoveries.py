"""Many tests at once, against their rule written out."""

import numpy as np

from deatwin.ident.mismatch.locate.discoveries import discoveries
from deatwin.ident.mismatch.thresholds import CHANCE


def test_the_smallest_p_values_below_a_rising_limit_are_rejected():
    """Sorted, the largest k with p_k <= 0.05 k / n decides; all smaller ones are rejected with it."""
    rng = np.random.default_rng(11)
    for _ in range(50):
        p = rng.uniform(size=20) ** 4
        ordered = np.sort(p)
        below = np.flatnonzero(ordered <= CHANCE * np.arange(1, 21) / 20)
        limit = ordered[below[-1]] if below.size else -1.0
        np.testing.assert_array_equal(discoveries(p), p <= limit)


def test_a_test_without_a_value_rejects_nothing():
    np.testing.assert_array_equal(discoveries(np.array([np.nan, 1e-6, 0.9])), [False, True, False])
