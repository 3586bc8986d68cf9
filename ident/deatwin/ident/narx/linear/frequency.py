"""The frequency response of a linear model and the covariance that its parameters give it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.linear.polynomials import Orders, Polynomials

__all__ = ["LinearFrequencyResponse", "frequency_response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearFrequencyResponse:
    """G_i = B_i/(A F_i) on the unit circle, for each input.

    Parameters
    ----------
    omega : ndarray, shape (n,)
        Angular frequency in rad/s.
    values : ndarray of complex, shape (n_inputs, n)
        G_i in output unit by input unit.
    covariance : ndarray, shape (n_inputs, n, 2, 2)
        Covariance of real and imaginary part, to first order in the parameters.
    """

    omega: Array
    values: Complex
    covariance: Array

    def __post_init__(self) -> None:
        for array in (self.omega, self.values, self.covariance):
            array.setflags(write=False)


def frequency_response(
    orders: Orders, polynomials: Polynomials, theta_cov: Array, omega: Array, sample_time: float
) -> LinearFrequencyResponse:
    """Return the frequency response of each input.

    Parameters
    ----------
    orders : Orders
        Of the polynomials.
    polynomials : Polynomials
        Of the model.
    theta_cov : ndarray, shape (n_theta, n_theta)
        Covariance of the parameters in the order of ``orders``.
    omega : ndarray, shape (n,)
        Angular frequency in rad/s.
    sample_time : float
        Sampling interval in s.
    """
    p = polynomials
    shift = np.exp(-1j * omega * sample_time)

    def powers(first: int, count: int) -> Complex:
        return shift ** np.arange(first, first + count)[:, None]

    def at(polynomial: Array) -> Complex:
        return np.asarray(np.polyval(polynomial[::-1], shift), dtype=np.complex128)

    slots = np.split(np.arange(orders.n_theta), np.cumsum(orders.sizes)[:-1])
    m = len(p.b)
    values, covariance = [], []
    for i in range(m):
        denominator = at(p.a) * at(p.f[i])
        g = at(p.b[i]) / denominator
        gradient = np.zeros((orders.n_theta, omega.size), dtype=np.complex128)
        gradient[slots[0]] = -g / at(p.a) * powers(1, orders.na)
        gradient[slots[1 + i]] = powers(orders.nk[i], orders.nb[i]) / denominator
        gradient[slots[1 + m + i]] = -g / at(p.f[i]) * powers(1, orders.nf[i])
        parts = np.stack([gradient.real, gradient.imag])
        values.append(g)
        covariance.append(np.einsum("ajw,jk,bkw->wab", parts, theta_cov, parts))
    return LinearFrequencyResponse(omega=omega.copy(), values=np.array(values), covariance=np.array(covariance))
