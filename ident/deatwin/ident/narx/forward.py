"""Forward selection by orthogonal least squares: each step chooses the term with the largest error reduction ratio."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import Array

_DEPENDENT = 1e-20  # share of its squared norm left to a candidate that depends on the chosen ones: six digits
# Norms and products are updated until that of a candidate, or of the output, has fallen to this share, and then
# recomputed, so that cancellation never costs more than two digits.
_REFRESH = 1e-2
_EQUAL = 1.0 - 1e-12  # ratio above which gains differ only by rounding; the first such candidate is taken
_ROWS = 64  # rows orthogonalised at once: 5 MB for 10,000 samples


@dataclass(frozen=True, kw_only=True)
class SelectionStep:
    """One choice of a forward selection."""

    candidate: int  # Position of the chosen row
    err: float  # Error reduction ratio: the share of y'y that the candidate explains
    residual: float  # Residual sum of squares, square of the output's unit


def forward_selection(
    rows: Array, target: Array, max_terms: int, *, given: Array | None = None
) -> Iterator[SelectionStep]:
    """Choose rows one by one by the error reduction ratio (Chen, Billings, Luo, Int. J. Control 50 (1989) 1873-1896).

    Shapes: `rows` (n_candidates, n_samples); `target` (n_samples,); `given` (n_given, n_samples).
    """
    power = float(target @ target)
    sizes = np.einsum("ij,ij->i", rows, rows)
    count = 0 if given is None else len(given)
    limit = min(count + max_terms, target.size)
    basis = np.empty((limit, target.size))
    if given is not None:
        basis[:count] = np.linalg.qr(given.T)[0].T
    left = _orthogonal(target, basis[:count])
    norms, products = _renew(rows, np.arange(len(rows)), basis[:count], left)
    reference, square = norms.copy(), float(left @ left)
    free = np.ones(len(rows), dtype=bool)
    while count < limit:
        usable = free & (norms > _DEPENDENT * sizes)
        if not usable.any() or square == 0.0:
            return
        gain = np.divide(products**2, norms, out=np.full(norms.size, -1.0), where=usable)
        best = int(np.argmax(gain >= _EQUAL * gain.max()))
        free[best] = False
        direction = _orthogonal(rows[best], basis[:count])
        direction /= np.linalg.norm(direction)
        basis[count] = direction
        count += 1
        explained = float(direction @ left)
        left -= explained * direction
        yield SelectionStep(candidate=best, err=explained**2 / power, residual=float(left @ left))
        along = rows @ direction
        norms -= along**2
        products -= explained * along
        stale = np.flatnonzero(free & (norms < _REFRESH * reference))
        norms[stale], products[stale] = _renew(rows, stale, basis[:count], left)
        reference[stale] = norms[stale]
        if float(left @ left) < _REFRESH * square:
            products, square = rows @ left, float(left @ left)


def _renew(rows: Array, which: NDArray[np.intp], basis: Array, left: Array) -> tuple[Array, Array]:
    """Replace rows by their parts orthogonal to a basis; return their squared norms and products with the residual."""
    norms, products = np.empty(which.size), np.empty(which.size)
    for start in range(0, which.size, _ROWS):
        part = slice(start, start + _ROWS)
        some = rows[which[part]]
        if len(basis):
            some = rows[which[part]] = _orthogonal(some, basis)
        norms[part], products[part] = np.einsum("ij,ij->i", some, some), some @ left
    return norms, products


def _orthogonal(vectors: Array, basis: Array) -> Array:
    """Return the parts of row vectors that are orthogonal to the orthonormal rows of a basis; two passes suffice."""
    once = vectors - (vectors @ basis.T) @ basis
    return np.asarray(once - (once @ basis.T) @ basis, dtype=np.float64)
