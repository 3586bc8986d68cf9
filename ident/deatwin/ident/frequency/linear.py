"""The linear part of a NARX model about an equilibrium, and how it depends on the parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.checks import real_numbers
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]

_FOLD = 1e-9  # a static stiffness (1 at no feedback) below this is that of two equilibria which meet


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPart:
    """The linear part about an equilibrium: v(k) = sum_l a_l v(k-l) + sum_l b_l w(k-l).

    Parameters
    ----------
    output_lags : ndarray of int, shape (n_a,)
        Lags of v in samples.
    a : ndarray, shape (n_a,)
        Coefficients of v.
    input_lags : ndarray of int, shape (n_b,)
        Lags of w in samples.
    b : ndarray, shape (n_b,)
        Coefficients of w, output unit by input unit.
    input_index : ndarray of int, shape (n_b,)
        Input that each coefficient belongs to.
    a_theta, b_theta : ndarray, shape (n_a, n_terms) and (n_b, n_terms)
        Derivatives with respect to the model's parameters; the equilibrium moves along.
    """

    output_lags: NDArray[np.int64]
    a: Array
    input_lags: NDArray[np.int64]
    b: Array
    input_index: NDArray[np.int64]
    a_theta: Array
    b_theta: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane."""
        return poles_of(self.output_lags, self.a)

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))


def operating_input_of(model: NarxModel, operating_input: ArrayLike | None) -> Array:
    """Return the constant inputs at which a model is analysed.

    Parameters
    ----------
    model : NarxModel
        The model.
    operating_input : array_like, shape () or (n_inputs,), or None
        In the inputs' units; None for the centre of the training data, 0 when that is unknown.

    Raises
    ------
    ModelError
        If the inputs are not as many finite numbers as the model has inputs, or the model has several outputs or
        noise terms.
    """
    model.require_one_output("frequency analysis")
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
        The model.
    operating_input : array_like, shape () or (n_inputs,)
        Constant input in the inputs' units.
    output : float
        Equilibrium output there, in the output's unit.

    Returns
    -------
    LinearPart

    Raises
    ------
    ModelError
        If the equilibrium is about to vanish, so that it has no derivative.
    """
    inputs = operating_input_of(model, operating_input)
    variables, exponents = model.table.variables, model.table.exponents
    values = levels(model, inputs, output)
    is_output = np.array([v.kind == "y" for v in variables], dtype=bool)
    outputs = [j for j, v in enumerate(variables) if v.kind == "y"]
    first = _slopes(model, values)
    # A slope depends on a parameter directly, and through the equilibrium by its own slope along the output.
    along = np.array([
        sum(float(_derivative(exponents, values, (j, i)) @ model.theta) for i in outputs)
        for j in range(len(variables))
    ])  # fmt: skip
    by_theta = first + np.outer(along, motion(model, values))
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
    """Return the value of each variable of a model at an equilibrium.

    Parameters
    ----------
    model : NarxModel
        The model.
    inputs : ndarray, shape (n_inputs,)
        Constant inputs in their units.
    output : float
        Equilibrium output in its unit.

    Returns
    -------
    ndarray, shape (n_variables,)
    """
    return np.array([output if v.kind == "y" else inputs[v.index] for v in model.table.variables])


def _slopes(model: NarxModel, values: Array) -> Array:
    """Return the derivative of each term by each variable, shape (n_variables, n_terms)."""
    rows = [_derivative(model.table.exponents, values, (j,)) for j in range(values.size)]
    return np.array(rows).reshape(values.size, len(model.terms))


def feedback(model: NarxModel, values: Array) -> tuple[NDArray[np.int64], Array]:
    """Return how the past outputs act in the linear part.

    Parameters
    ----------
    model : NarxModel
        The model.
    values : ndarray, shape (n_variables,)
        Value of each of its variables at the equilibrium, as `levels` returns them.

    Returns
    -------
    lags : ndarray of int, shape (n_a,)
        Lags in samples.
    a : ndarray, shape (n_a,)
        Coefficients.
    """
    chosen = [j for j, v in enumerate(model.table.variables) if v.kind == "y"]
    lags = np.array([model.table.variables[j].lag for j in chosen], dtype=np.int64)
    return lags, (_slopes(model, values) @ model.theta)[chosen]


def motion(model: NarxModel, values: Array) -> Array:
    """Return how the equilibrium moves with the parameters, dy/dtheta = terms / (1 - sum a).

    Parameters
    ----------
    model : NarxModel
        The model.
    values : ndarray, shape (n_variables,)
        Value of each of its variables at the equilibrium, as `levels` returns them.

    Returns
    -------
    ndarray, shape (n_terms,)

    Raises
    ------
    ModelError
        If the equilibrium is about to vanish, so that it has no derivative.
    """
    stiffness = 1.0 - float(feedback(model, values)[1].sum())
    if abs(stiffness) < _FOLD:
        raise ModelError(
            "two equilibria meet at this operating input, so that the equilibrium has no derivative; "
            "choose another operating input"
        )
    return model.table.at(values) / stiffness


def poles_of(lags: NDArray[np.int64], a: Array) -> NDArray[np.complex128]:
    """Return the poles in the z plane, the roots of 1 - sum_l a_l z^-l.

    Parameters
    ----------
    lags : ndarray of int, shape (n_a,)
        Lags in samples.
    a : ndarray, shape (n_a,)
        Coefficients.

    Returns
    -------
    ndarray of complex, shape (largest lag,)
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
