"""What a fit's parameters can take up of its readings, to first order."""

from __future__ import annotations

import numpy as np

__all__ = ["linearised_rms", "linearised_step", "taken_off", "tangent_basis"]


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


def linearised_step(residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Where the parameters would have to go for what `linearised_rms` leaves.

    Parameters
    ----------
    residuals : ndarray, shape (m,)
        Measured minus simulated.
    jacobian : ndarray, shape (m, n)
        Derivative of what is simulated by the parameters, of whatever scales.

    Returns
    -------
    ndarray, shape (n,)
        In those scales, the shortest such step; 0 of a parameter that does nothing.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    scales = np.where(sizes > 0.0, sizes, 1.0)
    return np.linalg.lstsq(jacobian / scales, residuals, rcond=None)[0] / scales
