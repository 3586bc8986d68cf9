"""Operating points of a NARX model: equilibria, the linear part there, and the model of deviations from it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from math import comb

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.narx.model import NarxModel, read_only
from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]

_PATH_STEPS = 32  # steps from the centre of the training data to the operating input


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium:
    """The equilibria of a model at a constant input, and the one the data are near.

    Parameters
    ----------
    operating_input : ndarray, shape (n_inputs,)
        The constant input in the inputs' units.
    outputs : ndarray, shape (n_equilibria,)
        All real equilibria, increasing, in the output's unit.
    stable : ndarray of bool, shape (n_equilibria,)
        Whether the linear part at each has all its poles inside the unit circle.
    chosen : int
        The one that the training data are near.
    """

    operating_input: Array
    outputs: Array
    stable: NDArray[np.bool_]
    chosen: int

    @property
    def output(self) -> float:
        """The chosen equilibrium in the output's unit."""
        return float(self.outputs[self.chosen])

    @property
    def is_stable(self) -> bool:
        """Whether the chosen equilibrium is stable."""
        return bool(self.stable[self.chosen])


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
        order = int(self.output_lags.max(initial=0))
        denominator = np.zeros(order + 1)
        denominator[0] = 1.0
        denominator[self.output_lags] = -self.a
        return np.asarray(np.roots(denominator), dtype=np.complex128)

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
        If the number of inputs is not the model's.
    """
    count = len(model.input_names)
    if operating_input is None:
        return np.zeros(count) if model.operating is None else model.operating.input_centre
    values = np.atleast_1d(np.asarray(operating_input, dtype=np.float64))
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ModelError(f"operating_input must be {count} finite number(s); got {operating_input!r}")
    return values


def equilibrium(model: NarxModel, operating_input: ArrayLike | None = None) -> Equilibrium:
    """Find all real equilibria of a model at a constant input.

    The one the data are near is followed from the centre of the training data to the operating input; a model
    without training data is taken to be at zero output for zero input.

    Parameters
    ----------
    model : NarxModel
        The model.
    operating_input : array_like, shape () or (n_inputs,), optional
        Constant input in the inputs' units; the centre of the training data by default.

    Returns
    -------
    Equilibrium

    Raises
    ------
    ModelError
        If there is no real equilibrium, or every output is one.
    """
    target = operating_input_of(model, operating_input)
    roots = _real_equilibria(model, target)
    if roots.size == 0:
        raise ModelError(f"the model has no real equilibrium at the input {target.tolist()} "
                         f"{'/'.join(model.input_units)}; its free run cannot settle there")
    start = np.zeros_like(target) if model.operating is None else model.operating.input_centre
    near = 0.0 if model.operating is None else float(model.operating.output_centre[0])
    for fraction in np.linspace(0.0, 1.0, _PATH_STEPS + 1) if np.any(start != target) else [1.0]:
        here = _real_equilibria(model, start + fraction * (target - start))
        if here.size:
            near = float(here[np.argmin(np.abs(here - near))])
    stable = np.array([linear_part(model, target, output).is_stable for output in roots])
    return Equilibrium(operating_input=read_only(target), outputs=read_only(roots), stable=stable,
                       chosen=int(np.argmin(np.abs(roots - near))))


def _real_equilibria(model: NarxModel, inputs: Array) -> Array:
    """Return the real roots of f(y, ..., y; u) - y, increasing."""
    is_output = np.array([v.kind == "y" for v in model.table.variables], dtype=bool)
    levels = np.array([1.0 if v.kind == "y" else inputs[v.index] for v in model.table.variables])
    degrees = model.table.exponents[:, is_output].sum(axis=1)
    coefficients = np.bincount(degrees, weights=model.theta * model.table.at(levels),
                               minlength=max(int(degrees.max()), 1) + 1)
    sizes = np.bincount(degrees, weights=np.abs(model.theta * model.table.at(levels)), minlength=coefficients.size)
    coefficients[1] -= 1.0
    sizes[1] += 1.0
    # In units of the data no coefficient is large only because metres are; what cancels to rounding is zero.
    scale = 1.0 if model.operating is None else _output_size(model)
    powers = scale ** np.arange(coefficients.size)
    scaled, sizes = coefficients * powers, sizes * powers
    scaled[np.abs(scaled) <= 4 * np.finfo(float).eps * sizes] = 0.0
    scaled = np.trim_zeros(scaled, "b")
    if scaled.size == 0:
        raise ModelError("every output is an equilibrium of the model: it integrates")
    roots = np.asarray(polynomial.polyroots(scaled))
    close = roots[np.abs(roots.imag) <= 1e-6 * np.maximum(np.abs(roots), 1e-3)].real
    polished = _newton(scaled, close)
    terms = polynomial.polyval(np.abs(polished), np.abs(scaled))
    real = polished[np.abs(polynomial.polyval(polished, scaled)) <= 1e-12 * terms]
    return np.unique(real) * scale


def _output_size(model: NarxModel) -> float:
    if model.operating is None:
        return 1.0
    return float(np.abs([model.operating.output_min, model.operating.output_max]).max()) or 1.0


def _newton(coefficients: Array, roots: Array) -> Array:
    """Polish real roots; three steps suffice from the accuracy of eigenvalues."""
    slope = polynomial.polyder(coefficients)
    for _ in range(3):
        steepness = polynomial.polyval(roots, slope)
        roots = roots - np.divide(polynomial.polyval(roots, coefficients), steepness,
                                  out=np.zeros_like(roots), where=steepness != 0)
    return roots


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
    """
    inputs = operating_input_of(model, operating_input)
    variables, exponents = model.table.variables, model.table.exponents
    is_output = np.array([v.kind == "y" for v in variables], dtype=bool)
    values = np.array([output if v.kind == "y" else inputs[v.index] for v in variables])
    first = np.array([_derivative(exponents, values, (j,)) for j in range(len(variables))]).reshape(-1, len(model.terms))
    slopes = first @ model.theta
    # The equilibrium moves with the parameters: dy/dtheta = terms / (1 - sum a); and the slopes move with it.
    moves = model.table.at(values) / (1.0 - slopes[is_output].sum())
    along = np.array([sum(_derivative(exponents, values, (j, i)) @ model.theta for i in np.flatnonzero(is_output))
                      for j in range(len(variables))])
    by_theta = first + np.outer(along, moves)
    lags = np.array([v.lag for v in variables], dtype=np.int64)
    index = np.array([v.index for v in variables], dtype=np.int64)
    return LinearPart(output_lags=lags[is_output], a=slopes[is_output], a_theta=by_theta[is_output],
                      input_lags=lags[~is_output], b=slopes[~is_output], b_theta=by_theta[~is_output],
                      input_index=index[~is_output])


def _derivative(exponents: NDArray[np.int64], values: Array, by: tuple[int, ...]) -> Array:
    """Return the partial derivative of every term by the named variables, one after the other."""
    factor, powers = np.ones(exponents.shape[0]), exponents.copy()
    for j in by:
        factor *= powers[:, j]
        powers[:, j] = np.maximum(powers[:, j] - 1, 0)
    return np.asarray(factor * np.prod(values ** powers, axis=1), dtype=np.float64)


def remove_dc(model: NarxModel, operating_input: ArrayLike | None = None) -> NarxModel:
    """Return the model of the deviations v = y - ybar and w = u - ubar from an equilibrium.

    The polynomial is expanded about the equilibrium: parameters change, terms of lower degree appear, and the
    constant vanishes. (Deleting the constant instead is wrong whenever the model has nonlinear terms.) The free run of
    the result equals that of the original. The covariance is carried over to first order, the motion of the
    equilibrium with the parameters included.

    Parameters
    ----------
    model : NarxModel
        The model.
    operating_input : array_like, shape () or (n_inputs,), optional
        Constant input ubar in the inputs' units; the centre of the training data by default.

    Returns
    -------
    NarxModel
        Without a constant; its ``operating`` range is that of the deviations, with its centre at 0.

    Raises
    ------
    ModelError
        If the model has no equilibrium there, or no term is left.
    """
    point = equilibrium(model, operating_input)
    expansion: dict[Term, Array] = defaultdict(lambda: np.zeros(len(model.terms)))
    slope: dict[Term, Array] = defaultdict(lambda: np.zeros(len(model.terms)))
    for m, term in enumerate(model.terms):
        for remaining, share, change in _expand(term, point):
            expansion[remaining][m] += share
            slope[remaining][m] += change
    expansion.pop(Term(()), None)
    if not expansion:
        raise ModelError("the model is constant: nothing is left without its operating point")
    terms = tuple(sorted(expansion, key=lambda t: (t.degree, t.factors)))
    matrix = np.array([expansion[term] for term in terms])
    variables = model.table.variables
    values = np.array([point.output if v.kind == "y" else point.operating_input[v.index] for v in variables])
    feedback = linear_part(model, point.operating_input, point.output).a.sum()
    moves = model.table.at(values) / (1.0 - feedback)
    jacobian = matrix + np.outer(np.array([slope[term] for term in terms]) @ model.theta, moves)
    at = ", ".join(f"{value:.9g} {unit}".strip() for value, unit in
                   zip((*point.operating_input, point.output), (*model.input_units, *model.output_units), strict=True))
    shifted = None if model.operating is None else model.operating.shifted(
        point.operating_input, np.array([point.output]))
    return replace(model, terms=terms, theta=matrix @ model.theta, theta_cov=jacobian @ model.theta_cov @ jacobian.T,
                   operating=shifted, provenance={**model.provenance, "deviations_from": at})


def _expand(term: Term, point: Equilibrium) -> Iterator[tuple[Term, float, float]]:
    """Yield the terms of a product of (value + deviation)^power, each with its weight and d weight / d output."""
    parts: list[tuple[tuple[Variable, ...], float, float]] = [((), 1.0, 0.0)]
    for variable, power in term.factors:
        is_output = variable.kind == "y"
        level = point.output if is_output else float(point.operating_input[variable.index])
        grown = []
        for kept in range(power + 1):
            rest = power - kept
            weight = comb(power, kept) * level ** rest
            change = comb(power, kept) * rest * level ** (rest - 1) if is_output and rest else 0.0
            grown += [(factors + (variable,) * kept, w * weight, w * change + d * weight) for factors, w, d in parts]
        parts = grown
    for factors, weight, change in parts:
        yield Term.product(factors), weight, change
