"""Part of a signal that a fit's parameters can explain, to first order."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear


def tangent_basis(jacobian: np.ndarray) -> np.ndarray:
    """Return the directions in which parameters change the readings. Shapes: `jacobian` (m, n); returns (m, r)."""
    sizes = np.linalg.norm(jacobian, axis=0)
    acting = sizes > 0.0
    return np.linalg.qr(jacobian[:, acting] / sizes[acting])[0]


def taken_off(signal: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return the part of a signal that the parameters cannot explain. Shapes: `signal` (m,); `basis` (m, r)."""
    return signal - basis @ (basis.T @ signal)


def linearised_rms(residuals: np.ndarray, jacobian: np.ndarray) -> float:
    """Return the rms residual of an unbounded linear model of a fit. Shapes: `residuals` (m,); `jacobian` (m, n)."""
    return float(np.sqrt(np.mean(taken_off(residuals, tangent_basis(jacobian)) ** 2)))


def bounded_fit(
    residuals: np.ndarray, jacobian: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the residual (m,) of a linear model of a fit within bounds; `jacobian` (m, n)."""
    sizes = np.linalg.norm(jacobian, axis=0)
    scales = np.where(sizes > 0.0, sizes, 1.0)
    basis, small = np.linalg.qr(jacobian / scales)  # parameters cannot change the rest of the residuals
    found = lsq_linear(small, basis.T @ residuals, (lower * scales, upper * scales), method="bvls")
    anywhere = float(np.mean(residuals**2)) - linearised_rms(residuals, jacobian) ** 2
    taken = float(np.sum((basis.T @ residuals) ** 2) - 2.0 * found.cost) / residuals.size
    return max(anywhere - taken, 0.0), found.active_mask != 0


def least_within(residuals: np.ndarray, jacobian: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """Return the least mean square residual of a linear model of a fit within bounds. Shapes: as for `bounded_fit`."""
    return linearised_rms(residuals, jacobian) ** 2 + bounded_fit(residuals, jacobian, lower, upper)[0]
