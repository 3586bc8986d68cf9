"""Polynomials of the backward shift, many at once: products, values on the unit circle, stability."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import polynomials, taking
from deatwin.control.errors import ControlError
from deatwin.ident.frequency.many import stable_polynomials
from deatwin.plant.arrays import Array, Complex

_NEAR = 1e-5
"""Distance from the unit circle within which poles are not left to the recursion of Schur and Cohn, whose rounding
grows there."""


@taking(first=polynomials, second=polynomials)
def in_series(first: ArrayLike, second: ArrayLike) -> Array:
    """Multiply the polynomials of two systems in series, for example the numerators of a model and a controller.

    The products are the numerators and denominators that `margins` needs.

    Parameters
    ----------
    first, second : array_like, shapes (..., n) and (..., m)
        Coefficients of z^0, z^-1, ... of one polynomial, or of several along leading axes, which broadcast against each
        other.

    Returns
    -------
    ndarray, shape (..., n + m - 1)
        Coefficients of the products.

    Raises
    ------
    ControlError
        If there are no coefficients, if a coefficient is not a real number, or if the leading axes do not broadcast.

    Examples
    --------
    >>> in_series([1.0, 2.0], [1.0, 3.0])
    array([1., 5., 6.])
    """
    left, right = (np.atleast_1d(np.asarray(c, dtype=np.float64)) for c in (first, second))
    lead = _lead(left, right)
    product = np.zeros((*lead, left.shape[-1] + right.shape[-1] - 1))
    for lag in range(right.shape[-1]):
        product[..., lag : lag + left.shape[-1]] += left * right[..., lag : lag + 1]
    return product


def _lead(one: Array, other: Array) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(one.shape[:-1], other.shape[:-1])
    except ValueError:
        raise ControlError(
            f"families of polynomials of shapes {one.shape} and {other.shape} do not fit together"
        ) from None


def loop_polynomials(numerators: ArrayLike, denominators: ArrayLike) -> tuple[Array, Array, tuple[int, ...]]:
    """Arrange loops as rows of equal length. Shapes: `numerators, denominators` (..., n_b); returns (n, m)."""
    top, bottom = (np.atleast_2d(np.asarray(c, dtype=np.float64)) for c in (numerators, denominators))
    lead = _lead(top, bottom)
    size = max(top.shape[-1], bottom.shape[-1])
    rows = []
    for name, given in (("numerator", top), ("denominator", bottom)):
        full = np.zeros((*lead, size))
        full[..., : given.shape[-1]] = given
        rows.append(full.reshape(-1, size))
        if not np.isfinite(rows[-1]).all():
            place = int(np.flatnonzero(~np.isfinite(rows[-1]).all(axis=1))[0])
            raise ControlError(f"the {name} of loop {place} is not finite: leave out models that do not settle")
    empty = ~rows[1].any(axis=1)
    if empty.any():
        raise ControlError(f"the denominator of loop {int(np.flatnonzero(empty)[0])} is zero: it must begin with 1")
    return rows[0], rows[1], lead


def jet(columns: Array, angle: Array, order: int) -> tuple[Complex, ...]:
    """Return polynomials (n,) on the unit circle with derivatives by the angle; `columns` (m, n)."""
    turn = np.exp(-1j * angle)
    found = []
    for power in range(order + 1):
        total = np.zeros(angle.size, dtype=np.complex128)
        for lag in range(len(columns) - 1, -1, -1):  # Horner's rule
            total *= turn
            total += columns[lag] * float(lag**power)
        found.append(total * (-1j) ** power)
    return tuple(found)


def stable_loops(numerators: Array, denominators: Array) -> NDArray[np.bool_]:
    """Return whether all closed-loop poles lie inside the unit circle, (n,). Shapes: (n, m)."""
    # Schur and Cohn's recursion decides if it agrees with that of slightly shrunk and grown polynomials; otherwise
    # eigenvalues decide.
    closed = numerators + denominators
    posed = np.abs(closed[:, 0]) > 64 * np.finfo(float).eps * (np.abs(numerators[:, 0]) + np.abs(denominators[:, 0]))
    closed = closed / np.where(posed, closed[:, 0], 1.0)[:, None]
    closed[:, 0] = 1.0
    lags = np.arange(closed.shape[1])
    verdicts = [stable_polynomials(closed * radius**lags) for radius in (1.0 - _NEAR, 1.0, 1.0 + _NEAR)]
    stable = verdicts[1] & posed
    doubtful = np.flatnonzero((verdicts[0] | verdicts[1] | verdicts[2]) & ~np.all(verdicts, axis=0) & posed)
    if doubtful.size:
        stable[doubtful] = _eigenvalues_inside(closed[doubtful])
    return stable


def _eigenvalues_inside(closed: Array) -> NDArray[np.bool_]:
    size = closed.shape[1]
    companion = np.zeros((len(closed), size - 1, size - 1))
    companion[:, 1:, :-1] = np.eye(size - 2)
    companion[:, 0, :] = -closed[:, 1:]
    return np.asarray(np.all(np.abs(np.linalg.eigvals(companion)) < 1.0, axis=1))
