"""The frequency response of a linear model, in the form used for all models."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import read_only, whole_number
from deatwin.ident.frequency.dc import Equilibrium
from deatwin.ident.frequency.gfrf import checked_frequencies
from deatwin.ident.frequency.many import Evaluated, stable_polynomials
from deatwin.ident.frequency.parts import require_no_pole
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus, Pointwise
from deatwin.ident.narx.linear import LinearModel
from deatwin.ident.narx.linear.polynomials import Orders
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def frf(model: LinearModel, omega: ArrayLike, *, channel: int = 0) -> FrequencyResponse:
    """Compute the frequency response of an ARX, ARMAX, output-error or Box-Jenkins model, with its covariance.

    Parameters
    ----------
    model : deatwin.ident.narx.linear.LinearModel
        Model with the polynomials A, B and F; the response from an input is B/(A F).
    omega : array_like, shape (n,)
        Angular frequencies, rad/s, between minus and plus half the sampling rate.
    channel : int
        Index of the input, from 0.

    Returns
    -------
    FrequencyResponse
        Response H_1, output unit per input unit; its operating point is zero input.

    Raises
    ------
    ModelError
        If the model has no such input, the frequencies are not real numbers in that range, or one of the frequencies is
        that of a pole on the unit circle.
    """
    if not isinstance(model, LinearModel):
        raise ModelError(f"a {type(model).__name__} is not a LinearModel; gfrf computes the responses of a NarxModel")
    channel = whole_number(channel, "channel", 0, len(model.b) - 1)
    frequencies = checked_frequencies(omega, model.sample_time)
    point, angle = _at_rest(model), frequencies * model.sample_time
    for polynomial in (model.a, model.f[channel]):
        require_no_pole([(lag, -value) for lag, value in enumerate(polynomial[1:], start=1)], angle)
    units = (model.output_units[0], model.input_units[channel])
    return FrequencyResponse(
        symbol="H",
        order=1,
        values=_transfer(model.orders, model.theta, angle, channel),
        omega=frequencies,
        point=point,
        status=FrequencyStatus.at(point),
        unit="/".join(units) if all(units) else "",
        theta_cov=model.theta_cov,
        differentiate=Pointwise(partial(_transfer_gradient, model.orders, model.theta, channel=channel), angle),
        evaluate=Pointwise(partial(_of_many, model.orders, channel), angle),
    )


def _of_many(orders: Orders, channel: int, angle: Array, thetas: Array) -> Evaluated:
    m = len(orders.nb)
    ends = np.cumsum((0, *orders.sizes))
    feedbacks = [0, *range(1 + m, 1 + 2 * m)]  # A and each F
    ones = np.ones((len(thetas), 1))
    stable = [stable_polynomials(np.hstack([ones, thetas[:, ends[i] : ends[i + 1]]])) for i in feedbacks]
    return Evaluated(
        values=_transfer(orders, thetas, angle, channel),
        exists=np.ones(len(thetas), dtype=np.bool_),
        stable=np.all(stable, axis=0),
    )


def _at_rest(model: LinearModel) -> Equilibrium:
    """Return the equilibrium for zero input; infinite if the model integrates its offset, NaN if there is none."""
    stiffness = float(model.a.sum())
    with np.errstate(divide="ignore", invalid="ignore"):
        output = np.divide(model.offset, stiffness)
    return Equilibrium(
        operating_input=read_only(np.zeros(len(model.b))),
        outputs=read_only([output]),
        stable=np.array([model.is_stable]),
        chosen=0,
    )


def _transfer(orders: Orders, theta: Array, angle: Array, channel: int) -> Complex:
    """Return B_i/(A F_i) for one or many parameter vectors. Shapes: `theta` (..., n_theta); `angle` (n,); (..., n)."""
    a, b, f = _rows(orders, theta, angle, channel)
    return np.asarray(b / (a * f))


def _transfer_gradient(orders: Orders, theta: Array, angle: Array, channel: int) -> Complex:
    """Derivative of B_i/(A F_i) by the parameters. Shapes: `theta` (n_theta,); `angle` (n,); (n, n_theta)."""
    a, b, f = (values[:, None] for values in _rows(orders, theta, angle, channel))
    in_a, in_b, in_f = _slots(orders, channel)
    gradient = np.zeros((angle.size, orders.n_theta), dtype=np.complex128)
    gradient[:, in_a] = -b / (a**2 * f) * _powers(angle, 1, orders.na)
    gradient[:, in_b] = _powers(angle, orders.nk[channel], orders.nb[channel]) / (a * f)
    gradient[:, in_f] = -b / (a * f**2) * _powers(angle, 1, orders.nf[channel])
    return gradient


def _rows(orders: Orders, theta: Array, angle: Array, channel: int) -> tuple[Complex, Complex, Complex]:
    """Return A, B_i and F_i on the unit circle, each of shape (..., n)."""
    in_a, in_b, in_f = _slots(orders, channel)
    a = 1.0 + theta[..., in_a] @ _powers(angle, 1, orders.na).T
    b = theta[..., in_b] @ _powers(angle, orders.nk[channel], orders.nb[channel]).T
    f = 1.0 + theta[..., in_f] @ _powers(angle, 1, orders.nf[channel]).T
    return a, b, f


def _slots(orders: Orders, channel: int) -> tuple[slice, slice, slice]:
    """Return the places of the coefficients of A, B_i and F_i in the parameter vector."""
    ends = np.cumsum((0, *orders.sizes))
    m = len(orders.nb)
    a, b, f = (slice(int(ends[i]), int(ends[i + 1])) for i in (0, 1 + channel, 1 + m + channel))
    return a, b, f


def _powers(angle: Array, first: int, count: int) -> Complex:
    """Return q^-k on the unit circle, shape (n, count)."""
    return np.asarray(np.exp(-1j * angle[:, None] * np.arange(first, first + count)))
