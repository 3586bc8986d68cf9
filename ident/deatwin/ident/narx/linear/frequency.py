"""The frequency response of a linear model and its derivative by the parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.linear.polynomials import Orders

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def transfer(orders: Orders, theta: Array, angle: Array, channel: int) -> Complex:
    """Return B_i/(A F_i) for one or many parameter vectors. Shapes: `theta` (..., n_theta); `angle` (n,); returns
    (..., n).
    """
    a, b, f = _rows(orders, theta, angle, channel)
    return np.asarray(b / (a * f))


def transfer_gradient(orders: Orders, theta: Array, angle: Array, channel: int) -> Complex:
    """Return the derivative of B_i/(A F_i) by the parameters. Shapes: `theta` (n_theta,); `angle` (n,); returns (n,
    n_theta).
    """
    a, b, f = (values[:, None] for values in _rows(orders, theta, angle, channel))
    in_a, in_b, in_f = _slots(orders, channel)
    gradient = np.zeros((angle.size, orders.n_theta), dtype=np.complex128)
    gradient[:, in_a] = -b / (a**2 * f) * _powers(angle, 1, orders.na)
    gradient[:, in_b] = _powers(angle, orders.nk[channel], orders.nb[channel]) / (a * f)
    gradient[:, in_f] = -b / (a * f**2) * _powers(angle, 1, orders.nf[channel])
    return gradient


def _rows(orders: Orders, theta: Array, angle: Array, channel: int) -> tuple[Complex, Complex, Complex]:
    """A, B_i and F_i on the unit circle, each of shape (..., n)."""
    in_a, in_b, in_f = _slots(orders, channel)
    a = 1.0 + theta[..., in_a] @ _powers(angle, 1, orders.na).T
    b = theta[..., in_b] @ _powers(angle, orders.nk[channel], orders.nb[channel]).T
    f = 1.0 + theta[..., in_f] @ _powers(angle, 1, orders.nf[channel]).T
    return a, b, f


def _slots(orders: Orders, channel: int) -> tuple[slice, slice, slice]:
    """Where the coefficients of A, B_i and F_i stand in the parameter vector."""
    ends = np.cumsum((0, *orders.sizes))
    m = len(orders.nb)
    a, b, f = (slice(int(ends[i]), int(ends[i + 1])) for i in (0, 1 + channel, 1 + m + channel))
    return a, b, f


def _powers(angle: Array, first: int, count: int) -> Complex:
    """q^-k on the unit circle, shape (n, count)."""
    return np.asarray(np.exp(-1j * angle[:, None] * np.arange(first, first + count)))
