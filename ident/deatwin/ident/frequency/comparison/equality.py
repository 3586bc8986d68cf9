"""Test whether two vectors of means are equal: Hotelling's test for unequal covariances, and Holm's correction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx.robust import Cosines
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_FLAT = 1e-12  # share of the largest variance below which a direction has no scatter
_HALVINGS = 100  # bisections of the multiplier of a margin, to 1e-30 of its bound


class Scatter(NamedTuple):
    """Uncertainty of a vector of means."""

    scale: Array  # shape (..., q, q): Squared scale of its t law
    dof: float  # Degrees of freedom of that law; infinite for a normal law


@dataclass(frozen=True, kw_only=True)
class Equality:
    """Test of the hypothesis that two vectors of means are equal."""

    statistic: float  # Squared distance in units of its scatter; for a drift, the ratio of variances
    dof: tuple[float, float]
    p_value: float  # Probability of a larger statistic


def equality(difference: ArrayLike, scatters: Sequence[Scatter], margin: float = 0.0) -> Equality:
    """Test whether a difference (2,) of independent means is at most a margin (Krishnamoorthy, Yu, Stat. Probab. Lett. 66
    (2004) 161-169); of several differences, the largest p-value counts (Berger, Technometrics 24 (1982) 295-300)."""
    from scipy.stats import chi2, f

    inverse, rank = _inverted(np.asarray(sum(s.scale for s in scatters), dtype=np.float64))
    statistic = _beyond(np.asarray(difference, dtype=np.float64), inverse, margin)
    freedom = np.broadcast_to(_freedom(inverse, scatters, rank), statistic.shape)
    second = freedom - rank + 1
    if np.isinf(freedom).all():
        p = chi2.sf(statistic, rank)
    else:
        p = f.sf(statistic * second / (freedom * rank), rank, second)
    worst = np.unravel_index(np.argmax(p), p.shape)
    return Equality(statistic=float(statistic[worst]), dof=(float(rank), float(second[worst])), p_value=float(p[worst]))


def _inverted(total: Array) -> tuple[Array, int]:
    """Return inverse scales of the directions that have scatter, and the number of these directions."""
    sizes, directions = np.linalg.eigh(total)
    largest = sizes[..., -1:]
    if not np.all(largest > 0):
        raise ModelError("the models have no covariance: nothing says whether a difference is significant")
    kept = sizes > _FLAT * largest
    inverse = np.where(kept, 1.0, 0.0) / np.where(kept, sizes, 1.0)
    return (directions * inverse[..., None, :]) @ directions.swapaxes(-1, -2), int(kept.sum(axis=-1).max())


def _freedom(inverse: Array, scatters: Sequence[Scatter], rank: int) -> Array:
    """Degrees of freedom of the sum of the scatters (Krishnamoorthy and Yu)."""
    rates: Array = np.zeros(inverse.shape[:-2])
    for scale, dof in scatters:
        share = scale @ inverse
        trace = np.trace(share, axis1=-2, axis2=-1)
        rates = rates + (np.trace(share @ share, axis1=-2, axis2=-1) + trace**2) / dof
    with np.errstate(divide="ignore"):
        return np.asarray((rank + rank**2) / rates, dtype=np.float64)


def _beyond(difference: Array, inverse: Array, margin: float) -> Array:
    """Return the smallest squared distance to a point whose distance from zero is within the margin."""
    if margin <= 0:
        return np.asarray(np.einsum("...i,...ij,...j->...", difference, inverse, difference), dtype=np.float64)
    # The nearest point x of the disc solves (A + t) x = A d with A the inverse scale; t >= 0 shrinks x to the margin.
    sizes, axes = np.linalg.eigh(inverse)
    along = np.einsum("...ij,...i->...j", axes, difference)
    low = np.zeros(along.shape[:-1])
    high = sizes.max(axis=-1) * np.linalg.norm(along, axis=-1) / margin
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        nearest = sizes * along / (sizes + middle[..., None] + np.finfo(float).tiny)
        far = np.linalg.norm(nearest, axis=-1) > margin
        low, high = np.where(far, middle, low), np.where(far, high, middle)
    left = along * high[..., None] / (sizes + high[..., None] + np.finfo(float).tiny)
    return np.asarray(np.sum(sizes * left**2, axis=-1), dtype=np.float64)


def holm(p_values: ArrayLike) -> Array:
    """Correct p-values (n,) for their number (Holm, Scand. J. Stat. 6 (1979) 65-70)."""
    given = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    corrected = np.empty_like(given)
    corrected[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(given.size, 0, -1)), 1.0)
    return corrected


def no_drift(cosines: Cosines) -> Equality:
    """Test for drift: are slow cosines no larger than others (Rao, Bull. Inst. Int. Stat. 33 (1951) 177)?"""
    slow, fast = cosines.slow, cosines.fast
    if cosines.n_slow == 0 or slow.shape[1] > 2:
        raise ModelError(f"{cosines.n_slow} slow cosines of {slow.shape[1]} series; give some, of one or two series")
    sizes, directions = np.linalg.eigh(fast.T @ fast)
    if not sizes[-1] > 0:
        raise ModelError("the series do not scatter: nothing says whether a drift is significant")
    kept = directions[:, sizes > _FLAT * sizes[-1]]
    counts = sorted({*(2**k for k in range(cosines.n_slow.bit_length())), cosines.n_slow})
    surest = min((_wilks(slow[:count] @ kept, fast @ kept) for count in counts), key=lambda test: test.p_value)
    return replace(surest, p_value=min(1.0, len(counts) * surest.p_value))


def _wilks(effect: Array, error: Array) -> Equality:
    """Test whether one or two series have larger values in ``effect`` than in ``error``."""
    from scipy.stats import f

    rank = effect.shape[1]
    within = error.T @ error
    ratio = float(np.linalg.det(within) / np.linalg.det(within + effect.T @ effect)) ** (1 / rank)
    first, second = rank * len(effect), rank * (len(error) - rank + 1)
    statistic = (1 - ratio) / ratio * second / first
    return Equality(statistic=statistic, dof=(first, second), p_value=float(f.sf(statistic, first, second)))
