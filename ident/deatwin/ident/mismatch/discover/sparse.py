"""Sparse regression of a residual on few functions, its stability under resampling, and its false discoveries.

No other module uses pysindy, of which only the forward regression by orthogonal least squares is needed. Sums of
products over blocks of samples contain all that a regression needs, so a resampled record has as few rows as columns.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.losses import block_length, evidence
from deatwin.ident.mismatch.thresholds import (
    ACCURACY,
    MOST_TERMS,
    NEARLY_ALL,
    PRACTICAL_SHARE,
    ROUNDING,
    TINY,
)
from deatwin.plant.arrays import Array

RESAMPLES = 60
ALIAS = 0.85
"""Correlation above which two columns count as one, because the readings can hardly distinguish them."""
NOTHING_OWN = 1e-2
"""Share of a column's length below which the nuisances imitate it completely."""
PERMUTATIONS = 40


@dataclass(frozen=True, kw_only=True)
class Stable:
    """A term that is chosen again and again."""

    column: int
    inclusion: float  # share of the resampled records that chose it, or one that can hardly be distinguished from it


def stable_terms(columns: Array, target: Array, nuisances: Array, rng: np.random.Generator) -> tuple[Stable, ...]:
    """Choose at most four columns, (n, k), that make up a target, (n,), the one chosen most often first.

    `nuisances`, (n, m), may be in the target in any amount.
    """
    # Each resampled record consists of blocks of neighbouring samples, drawn with replacement, and chooses its own
    # columns. Columns chosen in nine of ten records are kept if they gain more evidence than chance: among columns that
    # gain as much, at most one in ten may come from a target shifted against the columns. Meinshausen & Bühlmann,
    # "Stability selection", J. R. Stat. Soc. B 72 (2010) 417.
    basis = tangent_basis(nuisances)
    own = taken_off(columns, basis)
    size, whole = np.linalg.norm(own, axis=0), np.linalg.norm(columns, axis=0)
    unit = own * np.where(size > NOTHING_OWN * whole, 1 / np.maximum(size, TINY), 0.0)

    blocks = _blocks(unit, _freed(target, basis))
    chosen = [_forward(np.tensordot(_drawn(len(blocks), rng), blocks, 1), len(blocks)) for _ in range(RESAMPLES)]
    kept = _stable(chosen, np.abs(unit.T @ unit) > ALIAS)
    if not kept:
        return ()
    gains = _gains(blocks.sum(axis=0), [term.column for term in kept], len(blocks))
    margin = target.size // 10
    shifted = [np.roll(target, s) for s in rng.integers(margin, target.size - margin, size=PERMUTATIONS)]
    chance: list[float] = []
    for other in shifted:
        products = _blocks(unit, _freed(other, basis)).sum(axis=0)
        chance += _gains(products, _forward(products, len(blocks)), len(blocks))

    def false_discoveries(gain: float) -> float:
        return sum(g >= gain for g in chance) / PERMUTATIONS / sum(g >= gain for g in gains)

    return tuple(t for t, gain in zip(kept, gains, strict=True) if false_discoveries(gain) <= PRACTICAL_SHARE)


def _freed(target: Array, basis: Array) -> Array:
    """Return the part of a target that nuisances cannot explain, scaled to length 1."""
    left = taken_off(target, basis)
    return left / max(float(np.linalg.norm(left)), TINY)


def _stable(chosen: Sequence[Sequence[int]], aliases: NDArray[np.bool_]) -> list[Stable]:
    """From each group of indistinguishable columns chosen often enough, take the most frequent."""
    number = len(aliases)
    own = np.array([sum(j in support for support in chosen) for j in range(number)])
    shared = np.array([sum(aliases[j, list(support)].any() for support in chosen) for j in range(number)])
    kept: list[Stable] = []
    for j in np.argsort(-own, kind="stable"):
        taken = [term.column for term in kept]
        inclusion = float(shared[j] / len(chosen))
        if own[j] > 0 and inclusion >= NEARLY_ALL and not aliases[j, taken].any() and len(kept) < MOST_TERMS:
            kept.append(Stable(column=int(j), inclusion=inclusion))
    return kept


def _forward(products: Array, count: int) -> tuple[int, ...]:
    """Choose columns one after another, as many as the evidence from the blocks supports."""
    from pysindy import FROLS

    rows = _rows_of(products)
    size = np.linalg.norm(rows[:, :-1], axis=0)
    usable = np.flatnonzero(size > ACCURACY * size.max(initial=0.0))
    steps = min(MOST_TERMS, usable.size - 1)
    if steps < 1:
        return ()
    optimizer = FROLS(max_iter=steps, alpha=1e-10, normalize_columns=True, unbias=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of few rows for so many columns, but these rows are sums
        optimizer.fit(rows[:, usable], rows[:, -1:])
    supports = [tuple(int(j) for j in usable[np.flatnonzero(c[0])]) for c in optimizer.history_[: steps + 1]]
    return max(supports, key=lambda support: _evidence(products, support, count))


def _gains(products: Array, support: Sequence[int], count: int) -> list[float]:
    """Return the evidence that each term of a set adds to the others."""
    whole = _evidence(products, support, count)
    return [whole - _evidence(products, [k for k in support if k != j], count) for j in support]


def _evidence(products: Array, support: Sequence[int], count: int) -> float:
    """Return the log evidence of a least-squares fit of the target by a support."""
    picked = list(support)
    inner, cross = products[np.ix_(picked, picked)], products[picked, -1]
    explained = cross @ np.linalg.lstsq(inner, cross, rcond=ROUNDING)[0] if picked else 0.0
    return evidence(np.full(count, max(products[-1, -1] - explained, TINY)), len(picked))


def _blocks(unit: Array, target: Array) -> Array:
    """Sums of products of the columns and, last, the target over blocks of samples, shape (b, k + 1, k + 1)."""
    length = block_length(target.size)
    count = target.size // length
    parts = np.hstack([unit, target[:, None]])[: count * length].reshape(count, length, -1)
    return np.asarray(np.einsum("bij,bik->bjk", parts, parts))


def _drawn(count: int, rng: np.random.Generator) -> NDArray[np.int_]:
    """Return how often each block is drawn, in runs whose length is the square root of the number of blocks."""
    run = max(1, round(np.sqrt(count)))
    starts = rng.integers(0, count, size=-(-count // run))
    return np.bincount(((starts[:, None] + np.arange(run)) % count).ravel()[:count], minlength=count)


def _rows_of(products: Array) -> Array:
    """Return a square matrix whose rows have the given sums of products."""
    values, vectors = np.linalg.eigh(products)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
