"""Regressions whose terms are known."""

import numpy as np


def regression(seed: int, n_terms: int = 8, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Correlated regressors of which three count, one of them weakly."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((n_terms, n))
    rows[1] = rows[0] + 0.3 * rows[1]
    weights = np.zeros(n_terms)
    weights[[0, 2, 5]] = 0.5, 0.3, 0.15
    return rows, weights @ rows + 0.5 * rng.standard_normal(n)
