"""Stresses and tangents of a film, differentiated from any energy of the two in-plane stretches."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca

Symbol = Any


@lru_cache(maxsize=64)
def _differentiated(energy: Callable[..., Symbol], n_parameters: int) -> ca.Function:
    stretches, parameters = ca.SX.sym("stretches", 2), ca.SX.sym("parameters", n_parameters)
    value = energy(*ca.vertsplit(stretches), *ca.vertsplit(parameters))
    hessian, gradient = ca.hessian(value, stretches)
    inputs = [*ca.vertsplit(stretches), *ca.vertsplit(parameters)]
    return ca.Function(
        "differentiated", inputs, [gradient[0], gradient[1], hessian[0, 0], hessian[0, 1], hessian[1, 1]]
    )


def nominal_stress(
    energy: Callable[..., Symbol], stretch_1: Symbol, stretch_2: Symbol, *parameters: Symbol
) -> tuple[Symbol, Symbol]:
    """Nominal in-plane stresses dW/dlambda_i along 1 and 2, Pa; CasADi numbers if all arguments are floats."""
    first, second, *_ = _differentiated(energy, len(parameters))(stretch_1, stretch_2, *parameters)
    return first, second


def true_stress(
    energy: Callable[..., Symbol], stretch_1: Symbol, stretch_2: Symbol, *parameters: Symbol
) -> tuple[Symbol, Symbol]:
    r"""Return true stresses along 1 and 2, :math:`\lambda_i\,\partial W/\partial\lambda_i`, Pa; none across."""
    first, second = nominal_stress(energy, stretch_1, stretch_2, *parameters)
    return stretch_1 * first, stretch_2 * second


def tangent(
    energy: Callable[..., Symbol], stretch_1: Symbol, stretch_2: Symbol, *parameters: Symbol
) -> tuple[Symbol, Symbol, Symbol]:
    r"""Tangent stiffness :math:`\partial^2 W/\partial\lambda_i\partial\lambda_j` for ij = 11, 12 and 22, Pa."""
    _, _, *second = _differentiated(energy, len(parameters))(stretch_1, stretch_2, *parameters)
    return second[0], second[1], second[2]


def shear_modulus(energy: Callable[..., Symbol], *parameters: Symbol) -> Symbol:
    r"""Return the shear modulus at rest, :math:`\tfrac14\,\partial^2 W/\partial\lambda_1^2`, Pa."""
    return tangent(energy, 1.0, 1.0, *parameters)[0] / 4
