"""Check a covariance of parameters, compute its root, and transform it linearly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from deatwin.ident.arguments import read_only
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

# Largest difference of C_ij and C_ji, as a share of both deviations: an inverse of condition 1e12 still passes.
_UNEQUAL = 1e-3
# Negative eigenvalues down to this share of the largest are rounding, the square root of eps. A product J C J' may lose
# more; `transformed` forms it from roots.
_INDEFINITE = 2**-26


def covariance_of(
    values: ArrayLike, names: Sequence[object], complaint: str = "theta_cov is not a covariance matrix"
) -> Array:
    """Return a covariance (n, n), symmetric and read-only; ModelError if its correlations are indefinite."""
    given = np.asarray(values, dtype=np.float64)
    if not given.any():
        return read_only(given)
    sizes = _deviations(given, names, complaint)
    scaled = given / sizes[:, None] / sizes
    row, column = _worst(np.abs(scaled - scaled.T))
    if not abs(scaled[row, column] - scaled[column, row]) <= _UNEQUAL:
        raise ModelError(
            f"{complaint}, because it is not symmetric: it holds {given[row, column]:.6g} for {names[row]} and "
            f"{names[column]}, but {given[column, row]:.6g} for {names[column]} and {names[row]}"
        )
    _require_semidefinite(0.5 * (scaled + scaled.T), complaint)
    return read_only(0.5 * given + 0.5 * given.T)


def _deviations(given: Array, names: Sequence[object], complaint: str) -> Array:
    """Return standard deviations, or 1 where they are zero."""
    variances = np.diag(given)
    least = int(np.argmin(variances))
    if variances[least] < 0:
        raise ModelError(
            f"{complaint}: the variance of {names[least]} is {variances[least]:.3g}; it must not be negative"
        )
    certain = variances == 0
    beside = np.where(certain[:, None] | certain, np.abs(given), 0.0)
    if beside.any():
        row, column = _worst(beside)
        raise ModelError(
            f"{complaint}: it holds {given[row, column]:.3g} for {names[row]} and {names[column]}, "
            "one of which has the variance 0; that must be 0 too"
        )
    return np.where(certain, 1.0, np.sqrt(variances))


def _worst(sizes: Array) -> tuple[int, int]:
    row, column = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    return int(row), int(column)


def _require_semidefinite(scaled: Array, complaint: str) -> None:
    lifted = scaled + _INDEFINITE * np.eye(len(scaled))
    if lapack.dpotrf(lifted)[1] == 0:  # exists if no eigenvalue is below; in a tenth of the eigenvalues' time
        return
    eigenvalues = np.linalg.eigvalsh(scaled)
    if not eigenvalues[0] >= -_INDEFINITE * eigenvalues[-1]:
        raise ModelError(
            f"{complaint}, because its matrix of correlations has the negative eigenvalue {eigenvalues[0]:.3g} (the largest "
            f"is {eigenvalues[-1]:.3g})"
        )


def covariance_root(covariance: Array) -> Array:
    """Return R with R R' = covariance, also of a singular one. Shapes: `covariance` (..., n, n); returns (..., n, n)."""
    sizes = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    divisors = np.where(sizes > 0, sizes, 1.0)
    values, vectors = np.linalg.eigh(covariance / divisors[..., :, None] / divisors[..., None, :])
    return np.asarray(divisors[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def gram_inverse_root(columns: Array) -> Array:
    """Return R with R R' = (S'S)^+ for tall columns S, (n, n_columns), of any size; zero for a zero column."""
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    return np.asarray(np.linalg.pinv(np.linalg.qr(columns / norms, mode="r")) / norms[:, None])


def transformed(jacobian: Array, covariance: Array) -> Array:
    """Return J C J' as a valid covariance. Shapes: `jacobian` (n_new, n); `covariance` (..., n, n)."""
    root = jacobian @ covariance_root(covariance)
    product = root @ root.swapaxes(-1, -2)
    return np.asarray(0.5 * (product + product.swapaxes(-1, -2)))
