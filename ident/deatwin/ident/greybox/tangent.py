"""What a fit's parameters can take up of its readings, to first order."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

__all__ = ["bounded_fit", "linearised_rms", "taken_off", "tangent_basis"]


def tangent_basis(jacobian: np.ndarray) -> np.ndarray:
    """Directions in which parameters move the readings.

    Parameters
    ----------
    jacobian : ndarray, shape (m, n)
        Derivative of the readings by the parameters, of whatever scales.

    Returns
    -------
    ndarray, shape (m, r)
        Orthonormal; a parameter that does nothing, as on some bounds, has no direction.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    acting = sizes > 0.0
    return np.linalg.qr(jacobian[:, acting] / sizes[acting])[0]


def taken_off(signal: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """What is left of a signal where the parameters take up all they can.

    Parameters
    ----------
    signal : ndarray, shape (m,) or (m, k)
        Along the readings; several, one in each column.
    basis : ndarray, shape (m, r)
        From `tangent_basis`.

    Returns
    -------
    ndarray, of the shape of `signal`
    """
    return signal - basis @ (basis.T @ signal)


def linearised_rms(residuals: np.ndarray, jacobian: np.ndarray) -> float:
    """Rms of what a linear model of a fit would leave, wherever its parameters had to go for that.

    Parameters
    ----------
    residuals : ndarray, shape (m,)
        Measured minus simulated.
    jacobian : ndarray, shape (m, n)
        Derivative of what is simulated.

    Returns
    -------
    float
        In the unit of the residuals; never more than their own rms.
    """
    return float(np.sqrt(np.mean(taken_off(residuals, tangent_basis(jacobian)) ** 2)))


def bounded_fit(
    residuals: np.ndarray, jacobian: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[float, np.ndarray]:
    """What a linear model of a fit would leave, if its parameters may go so far only.

    Parameters
    ----------
    residuals : ndarray, shape (m,)
        Measured minus simulated.
    jacobian : ndarray, shape (m, n)
        Derivative of what is simulated by the parameters.
    lower, upper : ndarray, shape (n,)
        Least and largest change of each parameter, in its scale; the one below the other.

    Returns
    -------
    cost : float
        Mean square by which that is more than `linearised_rms` leaves, square of the residuals' unit.
    held : ndarray of bool, shape (n,)
        Parameters that are held at one of the two.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    scales = np.where(sizes > 0.0, sizes, 1.0)
    basis, small = np.linalg.qr(jacobian / scales)  # the rest of the residuals nothing can take
    found = lsq_linear(small, basis.T @ residuals, (lower * scales, upper * scales), method="bvls")
    anywhere = float(np.mean(residuals**2)) - linearised_rms(residuals, jacobian) ** 2
    taken = float(np.sum((basis.T @ residuals) ** 2) - 2.0 * found.cost) / residuals.size
    return max(anywhere - taken, 0.0), found.active_mask != 0
