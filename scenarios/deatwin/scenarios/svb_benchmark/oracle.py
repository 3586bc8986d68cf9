"""What one who knows the truth can reach with a test of significance, at the best threshold.

Two such oracles, because the first is no limit: least squares on all candidates shares out what the data say among
hundreds of parameters, and methods that fit few terms at a time see more. The second looks from the true terms: a
choice by the sum of squares and any price per term must take each true term for worth the price, no further term for
worth it, and no exchange of a true term for a false one for an improvement. Where these fail, the truth is not even
the best of its neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.regression import Regression
from deatwin.scenarios.svb_benchmark.trials import Rate, draw_of, system_of

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class Margin:
    """Between which thresholds a draw comes out exactly right."""

    true: float
    false: float


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """How far the true terms of a draw stand out."""

    full: Margin
    near: Margin
    redraws: int  # Runs that diverged before the draw
    snr_db: float  # Variance of the output over that of e(k), dB
    condition: float  # Condition number of the candidates, each scaled to length 1

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The contrast of plain data, as `dataclasses.asdict` makes it."""
        return cls(**{**data, "full": Margin(**data["full"]), "near": Margin(**data["near"])})


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """The best threshold of a system, and what is reached by it."""

    threshold: float
    exact: Rate
    kept: Rate


def full_margin(rows: Array, target: Array, true: Indices) -> Margin:
    """Compare |t| of true and false terms in least squares on all candidates. Shapes: `rows` (n_terms, n_samples);
    `target` (n_samples,).
    """
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


def contrast(name: str, seed: int, number: int) -> Contrast:
    """Compare true and false terms of a draw."""
    system = system_of(name)
    draw = draw_of(system, seed, number)
    data = Regression.of(
        draw.recording, output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree
    )
    true = np.array([data.table.terms.index(term) for term in system.terms])
    rows, target = data.matrix()
    ratio = draw.recording.outputs.var() / system.noise_std**2
    return Contrast(
        full=full_margin(rows, target, true),
        near=near_margin(rows, target, true),
        redraws=draw.redraws,
        snr_db=10 * float(np.log10(ratio)),
        condition=float(np.linalg.cond(rows / np.linalg.norm(rows, axis=1)[:, None])),
    )


def consult(margins: Sequence[Margin]) -> Oracle:
    """Choose the threshold by which most draws of a system come out exactly right; of equals the least."""
    true = np.array([margin.true for margin in margins])
    false = np.array([margin.false for margin in margins])
    # A draw comes out right if false <= threshold < true, so that one of the lower ends is best of all thresholds.
    thresholds = np.sort(false)
    exact = [(false <= threshold) & (threshold < true) for threshold in thresholds]
    best = int(np.argmax([flags.sum() for flags in exact]))
    return Oracle(threshold=float(thresholds[best]), exact=Rate.of(exact[best]), kept=Rate.of(true > thresholds[best]))


def _gains(rows: Array, target: Array, chosen: Indices) -> tuple[float, Array]:
    """Return the squares that chosen terms leave, and how many of them each further term would take."""
    q = np.linalg.qr(rows[chosen].T)[0]
    left = target - q @ (q.T @ target)
    beyond = rows - (rows @ q) @ q.T
    squares = np.einsum("ij,ij->i", beyond, beyond)
    new = squares > 1e-12 * np.einsum("ij,ij->i", rows, rows)  # the chosen ones have nothing beyond themselves
    gains = np.where(new, (beyond @ left) ** 2 / np.where(new, squares, 1.0), 0.0)
    return float(left @ left), np.asarray(gains, dtype=np.float64)
