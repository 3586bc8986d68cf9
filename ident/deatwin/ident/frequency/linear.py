"""The linear part of a NARX model about an equilibrium, its dependence on the parameters, and checks of arguments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.arguments import real_number, real_numbers, whole_number
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.variables import Variable, argument_of
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.errors import ModelError


def polynomial_model(model: Any) -> NarxModel:
    """Return a NarxModel, after a check that its terms are polynomial; other functions have infinitely many orders."""
    checked = require_model(model)
    if checked.table.functions:
        raise ModelError(
            f"frequency analysis needs a polynomial model, but this model contains {checked.table.functions[0]}: identify it without "
            "functions, or compute its response with best_linear_approximation from a simulation with a multisine"
        )
    return checked


def whole_order(order: Any, highest: int | None = None) -> int:
    """Return the order of a response, after a check."""
    return whole_number(order, "order", 1, highest)


_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPart(Frozen):
    """Linear part of a model about an equilibrium: v(k) = sum_l a_l v(k-l) + sum_l b_l w(k-l).

    v and w are the deviations of output and input from the equilibrium.

    Parameters
    ----------
    output_lags : ndarray of int, shape (n_a,)
        Lags of v, samples.
    a : ndarray, shape (n_a,)
        Coefficients of v.
    input_lags : ndarray of int, shape (n_b,)
        Lags of w, samples.
    b : ndarray, shape (n_b,)
        Coefficients of w, output unit per input unit.
    input_index : ndarray of int, shape (n_b,)
        Index of the input that each coefficient belongs to.
    a_theta, b_theta : ndarray, shape (n_a, n_terms) and (n_b, n_terms)
        Derivatives of `a` and `b` with respect to the model's parameters, including the shift of the equilibrium.
    """

    output_lags: NDArray[np.int64]
    a: Array
    input_lags: NDArray[np.int64]
    b: Array
    input_index: NDArray[np.int64]
    a_theta: Array
    b_theta: Array

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane."""
        return poles_of(self.output_lags, self.a)


def operating_input_of(model: NarxModel, operating_input: ArrayLike | None) -> Array:
    """Return the constant inputs at which a model is analysed. Shapes: `operating_input` ()."""
    require_model(model).require_one_output("frequency analysis")
    count = len(model.input_names)
    if operating_input is None:
        return np.zeros(count) if model.operating is None else model.operating.input_centre
    values = np.atleast_1d(real_numbers(operating_input, "operating_input"))
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelError(f"operating_input must be {wanted}; got {operating_input!r}")
    return values


def linear_part(model: NarxModel, operating_input: ArrayLike, output: float) -> LinearPart:
    """Linearise a model about an equilibrium.

    Parameters
    ----------
    model : NarxModel
        Identified model.
    operating_input : array_like, shape () or (n_inputs,)
        Constant inputs, in their units.
    output : float
        Output at the equilibrium, in its unit.

    Raises
    ------
    ModelError
        If the equilibrium has no derivative, because the model integrates or two equilibria coincide; if a term has no
        derivative, such as |u| at zero; or if the coefficients overflow.
    """
    inputs = operating_input_of(model, operating_input)
    arguments = levels(model, inputs, real_number(output, "output"))
    moves, first = motion(model, arguments), _slopes(model, arguments)
    # A slope depends on a parameter directly, and indirectly because the equilibrium moves with the parameter.
    by_theta = first + np.outer(_bends(model, arguments) @ model.theta, moves)
    lagged, gathering = _gathering(model)
    slopes, by_theta = gathering @ first @ model.theta, gathering @ by_theta
    is_output = np.array([kind == "y" for kind, _, _ in lagged], dtype=bool)
    index, lags = (np.array([key[i] for key in lagged], dtype=np.int64) for i in (1, 2))
    return LinearPart(
        output_lags=lags[is_output],
        a=slopes[is_output],
        a_theta=by_theta[is_output],
        input_lags=lags[~is_output],
        b=slopes[~is_output],
        b_theta=by_theta[~is_output],
        input_index=index[~is_output],
    )


def levels(model: NarxModel, inputs: Array, output: float) -> Array:
    """Return the arguments (n_variables,) of a model at an equilibrium, relative to its origin; `inputs` (n_inputs,)."""
    moved_in, moved_out = inputs - model.input_origin, output - model.output_origin[0]

    def lagged(v: Variable, lag: int) -> Array:
        return np.asarray(moved_out if v.kind == "y" else moved_in[v.index])

    return np.array([argument_of(v, lagged) for v in model.table.variables], dtype=np.float64)


def _applied(model: NarxModel, arguments: Array) -> tuple[Array, Array, Array]:
    """Return value, slope and curvature of each variable as a function of its argument, shapes (n_variables,)."""
    values, slopes, bends = arguments.copy(), np.ones(arguments.size), np.zeros(arguments.size)
    for j, v in enumerate(model.table.variables):
        if v.shape is None:
            continue
        x = np.asarray(arguments[j])
        if v.shape.bends_at(float(x)):
            raise ModelError(
                f"{v} has no derivative at the equilibrium, where its argument is {float(x):g}: choose another "
                "operating input, or identify a polynomial"
            )
        values[j], slopes[j], bends[j] = v.shape.value(x), v.shape.slope(x), v.shape.curvature(x)
    return values, slopes, bends


def _gathering(model: NarxModel) -> tuple[tuple[tuple[str, int, int], ...], Array]:
    """Return lagged signals by kind, row and lag, and the matrix (n_lagged, n_variables) of the slopes by them."""
    held = [
        [(v.kind, v.index, v.lag)] + ([(v.kind, v.index, v.reach)] if v.reach > v.lag else [])
        for v in model.table.variables
    ]
    lagged = tuple(dict.fromkeys(key for keys in held for key in keys))
    matrix = np.zeros((len(lagged), len(held)))
    for j, keys in enumerate(held):
        for key, sign in zip(keys, (1.0, -1.0), strict=False):  # the second signal of a difference has a minus sign
            matrix[lagged.index(key), j] += sign
    return lagged, matrix


def _slopes(model: NarxModel, arguments: Array) -> Array:
    """Return the derivative of each term by each argument, shape (n_variables, n_terms)."""
    values, slopes, _ = _applied(model, arguments)
    rows = [slope * _derivative(model.table.exponents, values, (j,)) for j, slope in enumerate(slopes)]
    return np.array(rows).reshape(values.size, len(model.terms))


def _bends(model: NarxModel, arguments: Array) -> Array:
    """Return the change of the slopes with the output at equilibrium, shape (n_variables, n_terms)."""
    values, slopes, curvatures = _applied(model, arguments)
    exponents = model.table.exponents
    moving = [j for j, v in enumerate(model.table.variables) if v.kind == "y" and v.reach == v.lag]
    found = np.zeros((values.size, len(model.terms)))
    for j in range(values.size):
        for i in moving:
            found[j] += slopes[j] * slopes[i] * _derivative(exponents, values, (j, i))
        if j in moving:
            found[j] += curvatures[j] * _derivative(exponents, values, (j,))
    return found


def feedback(model: NarxModel, arguments: Array) -> tuple[NDArray[np.int64], Array]:
    """Lags (n_a,) and coefficients (n_a,) of past outputs in the linear part. Shapes: `arguments` (n_variables,)."""
    lagged, gathering = _gathering(model)
    chosen = [j for j, (kind, _, _) in enumerate(lagged) if kind == "y"]
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = gathering @ _slopes(model, arguments) @ model.theta
    require_finite(slopes)
    return np.array([lagged[j][2] for j in chosen], dtype=np.int64), slopes[chosen]


def require_finite(coefficients: Array) -> None:
    """Raise an error if coefficients have overflowed."""
    if not np.all(np.isfinite(coefficients)):
        raise ModelError("the model's coefficients overflow at this operating input; choose one near the training data")


def motion(model: NarxModel, arguments: Array) -> Array:
    """Return dy/dtheta = terms / (1 - sum a) of the equilibrium, (n_terms,). Shapes: `arguments` (n_variables,)."""
    # The stiffness prod (1 - p) is naturally small for slow poles p. At a fold it is zero only to the square root of
    # rounding.
    a = feedback(model, arguments)[1]
    terms, stiffness = model.table.at(_applied(model, arguments)[0]), 1.0 - float(a.sum())
    degrees, curvature = _along_output(model, arguments)
    size = float(np.abs(model.theta) @ np.abs(terms))
    unsure = max(_ROUNDING * (1.0 + float(np.abs(a).sum())), 2 * np.sqrt(_ROUNDING * curvature) * np.sqrt(size))
    if abs(stiffness) > unsure:
        return terms / stiffness
    if np.any(degrees > 1):
        raise ModelError(
            "two equilibria meet at this operating input, so that the equilibrium has no derivative; "
            "choose another operating input"
        )
    raise ModelError("the model integrates: any output may be its equilibrium, so that it has no derivative")


def _along_output(model: NarxModel, values: Array) -> tuple[NDArray[np.int64], float]:
    """Return the degree of each term in the output, and the size of the second derivative of f(y)."""
    is_output = np.array([v.kind == "y" for v in model.table.variables], dtype=bool)
    degrees = model.table.exponents[:, is_output].sum(axis=1)
    if model.table.functions:  # as curved as a parabola, by an unknown amount
        return 2 * degrees, 0.0
    output = values[is_output][:1].sum()  # all outputs are equal at equilibrium
    weights = model.theta * model.table.at(np.where(is_output, 1.0, values))
    bends = degrees * (degrees - 1) * output ** np.maximum(degrees - 2, 0)
    return degrees, abs(float(weights @ bends))


def poles_of(lags: NDArray[np.int64], a: Array) -> NDArray[np.complex128]:
    """Poles in the z plane, roots of 1 - sum_l a_l z^-l, (largest lag,). Shapes: `lags`, `a` (n_a,)."""
    denominator = np.zeros(int(lags.max(initial=0)) + 1)
    denominator[0] = 1.0
    np.subtract.at(denominator, lags, a)
    return np.asarray(np.roots(denominator), dtype=np.complex128)


def _derivative(exponents: NDArray[np.int64], values: Array, by: tuple[int, ...]) -> Array:
    """Return the partial derivative of every term by the named variables, one after the other."""
    factor, powers = np.ones(exponents.shape[0]), exponents.copy()
    for j in by:
        factor *= powers[:, j]
        powers[:, j] = np.maximum(powers[:, j] - 1, 0)
    return np.asarray(factor * np.prod(values**powers, axis=1), dtype=np.float64)
