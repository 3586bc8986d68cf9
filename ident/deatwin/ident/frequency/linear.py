"""The linear part of a NARX model about an equilibrium, and how it depends on the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.checks import polynomial_model, real_numbers
from deatwin.ident.frequency.frozen import Frozen
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]

_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPart(Frozen):
    """Linear part of a model about an equilibrium: v(k) = sum_l a_l v(k-l) + sum_l b_l w(k-l).

    Parameters
    ----------
    output_lags : ndarray of int, shape (n_a,)
        Lags of v, samples.
    a : ndarray, shape (n_a,)
        Coefficients of v.
    input_lags : ndarray of int, shape (n_b,)
        Lags of w, samples.
    b : ndarray, shape (n_b,)
        Coefficients of w, output unit by input unit.
    input_index : ndarray of int, shape (n_b,)
        Index of the input that each coefficient belongs to.
    a_theta, b_theta : ndarray, shape (n_a, n_terms) and (n_b, n_terms)
        Derivatives with respect to the model's parameters, including the shift of the equilibrium.
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

    @property
    def is_stable(self) -> bool:
        """True if all poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))


def operating_input_of(model: NarxModel, operating_input: ArrayLike | None) -> Array:
    """Return the constant inputs at which a model is analysed. Shapes: `operating_input` ()."""
    polynomial_model(model).require_one_output("frequency analysis")
    count = len(model.input_names)
    if operating_input is None:
        return np.zeros(count) if model.operating is None else model.operating.input_centre
    values = np.atleast_1d(real_numbers(operating_input, "operating_input"))
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ModelError(f"operating_input must be {count} finite number(s); got {operating_input!r}")
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

    Returns
    -------
    LinearPart

    Raises
    ------
    ModelError
        If the model integrates or two equilibria coincide there, so that the equilibrium has no derivative; or if the
        coefficients overflow.
    """
    inputs = operating_input_of(model, operating_input)
    variables, exponents = model.table.variables, model.table.exponents
    values = levels(model, inputs, output)
    is_output = np.array([v.kind == "y" for v in variables], dtype=bool)
    outputs = [j for j, v in enumerate(variables) if v.kind == "y"]
    moves, first = motion(model, values), _slopes(model, values)
    # A slope depends on a parameter directly, and through the equilibrium by its own slope along the output.
    along = np.array(
        [
            sum(float(_derivative(exponents, values, (j, i)) @ model.theta) for i in outputs)
            for j in range(len(variables))
        ]
    )
    by_theta = first + np.outer(along, moves)
    slopes = first @ model.theta
    lags = np.array([v.lag for v in variables], dtype=np.int64)
    index = np.array([v.index for v in variables], dtype=np.int64)
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
    """Return the value of each variable of a model at an equilibrium, counted from the model's origin. Shapes:
    `inputs` (n_inputs,); returns (n_variables,).
    """
    moved_in, moved_out = inputs - model.input_origin, output - model.output_origin[0]
    return np.array([moved_out if v.kind == "y" else moved_in[v.index] for v in model.table.variables])


def _slopes(model: NarxModel, values: Array) -> Array:
    """Return the derivative of each term by each variable, shape (n_variables, n_terms)."""
    rows = [_derivative(model.table.exponents, values, (j,)) for j in range(values.size)]
    return np.array(rows).reshape(values.size, len(model.terms))


def feedback(model: NarxModel, values: Array) -> tuple[NDArray[np.int64], Array]:
    """Return how the past outputs act in the linear part. Shapes: `values` (n_variables,); returns (n_a,), Lags in
    samples; returns (n_a,).
    """
    chosen = [j for j, v in enumerate(model.table.variables) if v.kind == "y"]
    lags = np.array([model.table.variables[j].lag for j in chosen], dtype=np.int64)
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = _slopes(model, values) @ model.theta
    require_finite(slopes)
    return lags, slopes[chosen]


def require_finite(coefficients: Array) -> None:
    """Refuse coefficients that have overflowed."""
    if not np.all(np.isfinite(coefficients)):
        raise ModelError("the model's coefficients overflow at this operating input; choose one near the training data")


def motion(model: NarxModel, values: Array) -> Array:
    """Return how the equilibrium moves with the parameters, dy/dtheta = terms / (1 - sum a). Shapes: `values`
    (n_variables,); returns (n_terms,).
    """
    # The stiffness of slow poles p, prod (1 - p), is small by nature. At a fold it is zero only to the square root of
    # rounding.
    a = feedback(model, values)[1]
    terms, stiffness = model.table.at(values), 1.0 - float(a.sum())
    degrees, curvature = _along_output(model, values)
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
    """Return the degree of each term in the output, and the size of the second derivative of f(y) there."""
    is_output = np.array([v.kind == "y" for v in model.table.variables], dtype=bool)
    degrees = model.table.exponents[:, is_output].sum(axis=1)
    output = values[is_output][:1].sum()  # all are the same
    weights = model.theta * model.table.at(np.where(is_output, 1.0, values))
    bends = degrees * (degrees - 1) * output ** np.maximum(degrees - 2, 0)
    return degrees, abs(float(weights @ bends))


def poles_of(lags: NDArray[np.int64], a: Array) -> NDArray[np.complex128]:
    """Return the poles in the z plane, the roots of 1 - sum_l a_l z^-l. Shapes: `lags` (n_a,); `a` (n_a,); returns
    (largest lag,).
    """
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
