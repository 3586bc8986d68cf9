"""Smooth forms of corners and steps, so that a fit sees a derivative everywhere."""

from __future__ import annotations

from typing import Any

import casadi as ca

__all__ = ["smooth_magnitude", "smooth_sign", "smooth_step", "soft_excess"]

Symbol = Any


def smooth_magnitude(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of :math:`|x|`: :math:`\sqrt{x^2 + w^2} - w`.

    Parameters
    ----------
    value : symbol
        x.
    width : float
        w, in the unit of x; the departure is less than that, and zero at x = 0.

    Returns
    -------
    symbol
        In the unit of x.
    """
    return ca.sqrt(value**2 + width**2) - width


def smooth_sign(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of the sign of x, the slope of its `smooth_magnitude`: :math:`x/\sqrt{x^2 + w^2}`.

    Parameters
    ----------
    value : symbol
        x.
    width : float
        w, in the unit of x.

    Returns
    -------
    symbol
        Between -1 and 1.
    """
    return value / ca.sqrt(value**2 + width**2)


def soft_excess(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of :math:`\max(x, 0)`: :math:`w\ln(1 + e^{x/w})`.

    Parameters
    ----------
    value : symbol
        x.
    width : float
        w, in the unit of x; the largest departure, at x = 0, is :math:`w\ln 2`, and at 10 w it is 5e-5 w.

    Returns
    -------
    symbol
        In the unit of x.
    """
    # Written with |x| so that no exponential overflows.
    size = ca.fabs(value)
    return (value + size) / 2 + width * ca.log1p(ca.exp(-size / width))


def smooth_step(value: Symbol) -> Symbol:
    r"""Logistic step :math:`1/(1 + e^{-x})`: from 0.1 to 0.9 within 4.4.

    Parameters
    ----------
    value : symbol
        x, dimensionless.

    Returns
    -------
    symbol
        Between 0 and 1.
    """
    return (1 + ca.tanh(value / 2)) / 2
