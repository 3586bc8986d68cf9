"""Levels of an excitation, and the fit of the output's orders to its spectra at several levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.arguments import read_only
from deatwin.plant.arrays import Array, Booleans, Complex

_BETTER = 2.0  # ratio by which further orders must reduce the error to be taken
_ROUNDING = 1e-12  # share of the spectra that is rounding error
_NOTHING = 1e-10  # share of all orders below which an error is not truncation: an order that is zero has such an error


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelFit:
    """Orders of the output, fitted at each spectral line to the spectra at several levels."""

    levels: Array  # shape (n_levels,): Factors of the excitation
    orders: Complex
    condition: float  # Condition number of the powers of the levels, with columns scaled to unit length
    residual: Array
    left_out: Array
    changes: Array

    def advisable_level(self, order: int, share: float) -> float:
        """Return the factor on the levels that makes the truncation error a given share of the orders up to one."""
        # Truncation begins with order N + 1; its share of Y_n grows with the level to the power N + 1 - n. Levels in
        # pairs of both signs separate even from odd orders, so that the first omitted order of n's parity counts.
        paired = np.allclose(np.sort(self.levels), np.sort(-self.levels), rtol=1e-9, atol=0.0)
        rounding = _NOTHING * np.linalg.norm(self.orders)
        factors = [1.0]
        for n, (values, change) in enumerate(zip(self.orders[:order], self.changes, strict=False), start=1):
            error, allowed = np.linalg.norm(change), max(share * np.linalg.norm(values), rounding)
            power = len(self.orders) + 1 - n
            power += power % 2 if paired else 0
            factors.append(1.0 if error <= allowed else float(allowed / error) ** (1.0 / power))
        return float(np.min(factors))


def chebyshev_levels(count: int) -> Array:
    """Return Chebyshev nodes of both signs, the largest 1, for polynomials without a constant, (count,)."""
    # An even count omits level zero, which carries no information.
    angles = (2 * np.arange(count // 2) + 1) * np.pi / (2 * count)
    positive = np.cos(angles) / np.cos(angles[0])
    return read_only(np.concatenate([positive, -positive[::-1]]))


def fit_orders(levels: Array, spectra: Complex, in_range: Sequence[Booleans], tried: range) -> LevelFit:
    """Fit Y(a) = a Y_1 + a^2 Y_2 + ... at each line over levels; `spectra` (n_levels, n_lines)."""
    # Take the smallest number of orders whose leave-one-out error is at most twice the smallest.
    reached = np.array(in_range[: levels.size])
    left_out = _left_out(levels, spectra, reached, min(tried[-1], levels.size))
    errors = left_out[tried[0] - 1 :]
    number = tried[int(np.argmax(errors <= max(_BETTER * errors.min(), _ROUNDING)))]
    orders, _ = separated(_powers(levels, number)[0], spectra, reached[:number])
    changes = np.full(orders.shape, np.nan)
    more, sizes = _powers(levels, number + 2)
    if np.linalg.matrix_rank(more / sizes) == number + 2:
        changes = np.abs(separated(more, spectra, reached[: number + 2])[0][:number] - orders)
    powers, lengths = _powers(levels, number)
    return LevelFit(
        levels=levels,
        orders=orders,
        condition=float(np.linalg.cond(powers / lengths)),
        residual=_residual(powers, spectra, orders),
        left_out=left_out,
        changes=changes,
    )


def separated(powers: Array, spectra: Complex, in_range: Booleans) -> tuple[Complex, Complex]:
    """Return the fitted orders (n_orders, n_lines), and the residual at each level when it is left out of the fit."""
    lengths = np.linalg.norm(powers, axis=0)
    orders, left_out = np.zeros(in_range.shape, dtype=np.complex128), spectra.copy()
    sets, which = np.unique(in_range, axis=1, return_inverse=True)
    for number, present in enumerate(sets.T):
        if not present.any():
            continue
        lines = which.ravel() == number
        q, r = np.linalg.qr((powers / lengths)[:, present])
        projected = q.T @ spectra[:, lines]
        orders[np.ix_(present, lines)] = np.linalg.lstsq(r, projected, rcond=None)[0] / lengths[present, None]
        # Leaving out a level increases its residual by the factor 1 / (1 - leverage).
        freedom = np.maximum(1.0 - np.sum(q**2, axis=1), np.finfo(float).eps)
        left_out[:, lines] = (spectra[:, lines] - q @ projected) / freedom[:, None]
    return orders, left_out


def _left_out(levels: Array, spectra: Complex, in_range: Booleans, most: int) -> Array:
    """Return, for 1, 2, ... orders, the unexplained share of the spectra at levels that were left out of the fit."""
    errors = np.full(most, np.inf)
    for n in range(1, min(most, levels.size - 1) + 1):
        errors[n - 1] = np.linalg.norm(separated(_powers(levels, n)[0], spectra, in_range[:n])[1])
    return np.asarray(errors / (np.linalg.norm(spectra) or 1.0), dtype=np.float64)


def _residual(powers: Array, spectra: Complex, orders: Complex) -> Array:
    """Return the share of each spectrum that the first n orders do not explain, shape (n_levels, n_orders)."""
    sums = np.cumsum(powers[:, :, None] * orders, axis=1)
    left, size = np.linalg.norm(spectra[:, None, :] - sums, axis=2), np.linalg.norm(spectra, axis=1)[:, None]
    return np.divide(left, size, out=np.zeros_like(left), where=size > 0)


def _powers(levels: Array, n_orders: int) -> tuple[Array, Array]:
    """Return the matrix of the fit, shape (n_levels, n_orders), and the norms of its columns."""
    powers = levels[:, None] ** np.arange(1, n_orders + 1)
    return powers, np.linalg.norm(powers, axis=0)
