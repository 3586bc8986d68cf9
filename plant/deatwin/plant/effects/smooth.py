"""Smooth forms of corners and steps, so that derivatives exist everywhere."""

from __future__ import annotations

from typing import Any

import casadi as ca

Symbol = Any


def smooth_magnitude(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of :math:`|x|`: :math:`\sqrt{x^2 + w^2} - w`."""
    return ca.sqrt(value**2 + width**2) - width


def smooth_sign(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of the sign of x, the slope of its `smooth_magnitude`: :math:`x/\sqrt{x^2 + w^2}`."""
    return value / ca.sqrt(value**2 + width**2)


def soft_excess(value: Symbol, width: float) -> Symbol:
    r"""Smooth form of :math:`\max(x, 0)`: :math:`w\ln(1 + e^{x/w})`."""
    # Written with |x| so that no exponential overflows.
    size = ca.fabs(value)
    return (value + size) / 2 + width * ca.log1p(ca.exp(-size / width))


def smooth_step(value: Symbol) -> Symbol:
    r"""Logistic step :math:`1/(1 + e^{-x})`: from 0.1 to 0.9 within 4.4."""
    return (1 + ca.tanh(value / 2)) / 2


def soft_clip(value: Symbol, limit: Symbol, width: Symbol) -> Symbol:
    r"""Smooth form of x cut off at -a and a: :math:`\tfrac12[\sqrt{(x + a)^2 + w^2} - \sqrt{(x - a)^2 + w^2}]`."""
    above, below = (ca.sqrt((value + side * limit) ** 2 + width**2) for side in (1, -1))
    return (above - below) / 2
