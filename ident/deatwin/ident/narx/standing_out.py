"""Measure how far the true terms of a regression stand out from false ones, when the truth is known.

The second margin looks from the true terms: a price per term must be worth paying for each true term, for no further
one, and for no exchange with a false one; else the truth is not even the best of its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from deatwin.plant.arrays import Array, Indices
from deatwin.plant.records import UNBOUNDED


@dataclass(frozen=True, kw_only=True)
class Margin:
    """Range of thresholds, from `false` to `true`, that select exactly the true terms."""

    true: float = field(metadata=UNBOUNDED)
    false: float = field(metadata=UNBOUNDED)


def full_margin(rows: Array, target: Array, true: Indices) -> Margin:
    """Compare abs(t) of true and false terms in least squares on all candidates; `rows` (n_terms, n_samples)."""
    from scipy.linalg import solve_triangular

    q, r = np.linalg.qr((rows / np.linalg.norm(rows, axis=1)[:, None]).T)
    theta = solve_triangular(r, q.T @ target)
    spread = np.linalg.norm(solve_triangular(r, np.eye(theta.size)), axis=1)
    left = target - q @ (q.T @ target)
    sizes = np.abs(theta) / (spread * np.sqrt(left @ left / (target.size - theta.size)))
    return Margin(true=float(sizes[true].min()), false=float(np.delete(sizes, true).max()))


def near_margin(rows: Array, target: Array, true: Indices) -> Margin:
    """Compare the true terms with all sets that differ from them by one term, or by one exchange."""
    left, gains = _gains(rows, target, true)
    freedom = target.size - true.size
    most = float(np.delete(gains, true).max())
    false = np.sqrt(most / ((left - most) / (freedom - 1)))
    costs = []
    for term in true:
        others = true[true != term]
        worse, instead = _gains(rows, target, others)
        costs.append(worse - left)
        if worse - float(np.delete(instead, true).max()) < left:
            false = np.inf
    return Margin(true=float(np.sqrt(min(costs) / (left / freedom))), false=float(false))


def _gains(rows: Array, target: Array, chosen: Indices) -> tuple[float, Array]:
    """Return the residual sum of squares of chosen terms, and how much each further term would remove."""
    q = np.linalg.qr(rows[chosen].T)[0]
    left = target - q @ (q.T @ target)
    beyond = rows - (rows @ q) @ q.T
    squares = np.einsum("ij,ij->i", beyond, beyond)
    new = squares > 1e-12 * np.einsum("ij,ij->i", rows, rows)  # the chosen terms have no part beyond themselves
    gains = np.where(new, (beyond @ left) ** 2 / np.where(new, squares, 1.0), 0.0)
    return float(left @ left), np.asarray(gains, dtype=np.float64)
