"""Covariance of least squares under residuals that are correlated in time."""

from __future__ import annotations

import numpy as np

NOTHING = 1e-100
"""Length of a Jacobian's column below which its parameter has no effect. A variance is the squared reciprocal of the
length and must not overflow."""
RANK = 1e-12  # Share of the largest squared singular value below which a squared singular value counts as zero


def covariance(residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Covariance of least squares under residuals that are correlated in time."""
    # Newey-West at zero frequency, with lags up to the square root of the record: model errors are slow, so formulas
    # for white noise give intervals that are too narrow. The estimate is noisy and too low, so no variance may fall
    # below that for white noise.
    scaled, scale = _unit_columns(jacobian)
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=RANK)
    scores = scaled * residuals[:, None]
    # Weights that fall linearly with the lag are equivalent to overlapping windows, so that one product gives the sum
    # over all lags.
    window = int(np.sqrt(residuals.size)) + 1
    total = np.vstack([np.zeros(scale.size), np.cumsum(scores, axis=0)])
    ends = np.arange(1, residuals.size + window)
    sums = total[np.minimum(ends, residuals.size)] - total[np.maximum(ends - window, 0)]
    freedom = max(residuals.size - scale.size, 1)
    # A matrix times its own transpose: rounding cannot make an eigenvalue negative, however similar the parameters are.
    half = sums @ bread * np.sqrt(residuals.size / freedom / window)
    robust = half.T @ half
    white = float(residuals @ residuals) / freedom * np.diag(bread)
    own = np.diag(robust)
    widen = np.sqrt(np.divide(np.maximum(own, white), own, out=np.ones_like(own), where=own > 0))
    return robust * np.outer(widen, widen) / np.outer(scale, scale)


def with_errors(spread: np.ndarray, jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the covariance (p, p) of least squares with errors along `columns` (n, k) as well; `jacobian` (n, p)."""
    scaled, scale = _unit_columns(jacobian)
    carried = np.linalg.lstsq(scaled, columns, rcond=np.sqrt(RANK))[0] / scale[:, None]
    return np.asarray(spread + carried @ carried.T)


def beside(jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the part of `columns` (n, k) that least squares by `jacobian` (n, p) cannot explain, (n, k)."""
    scaled, _ = _unit_columns(jacobian)
    return np.asarray(columns - scaled @ np.linalg.lstsq(scaled, columns, rcond=np.sqrt(RANK))[0])


def white_variances(residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Return the variances (n,) of the coordinates for white residuals (m,); `jacobian` (m, n)."""
    scaled, scale = _unit_columns(jacobian)
    freedom = max(residuals.size - scale.size, 1)
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=RANK)
    return np.asarray(float(residuals @ residuals) / freedom * np.diag(bread) / scale**2)


def _unit_columns(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobian with columns of length 1, and the original lengths; 1 for a zero column."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale < NOTHING] = 1.0
    return jacobian / scale, scale
