"""Find operating points of a NARX model: its equilibria, its linear part there, and the model of deviations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from deatwin.ident.frequency.linear import (
    feedback,
    levels,
    motion,
    operating_input_of,
    poles_of,
    polynomial_model,
    require_finite,
)
from deatwin.ident.narx.covariance import transformed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.amplitudes import amount
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_PATH_STEPS = 32  # steps from the centre of the training data to the operating input


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium(Frozen):
    """All equilibria of a model under a constant input, and the one among them to which the training data lead.

    Parameters
    ----------
    operating_input : ndarray, shape (n_inputs,)
        Constant inputs, in their units.
    outputs : ndarray, shape (n_equilibria,)
        All real equilibria, increasing, in the output's unit.
    stable : ndarray of bool, shape (n_equilibria,)
        True if all poles of the linear part at the equilibrium lie inside the unit circle.
    chosen : int
        Index of the equilibrium to which the training data lead; see `equilibrium`.
    """

    operating_input: Array
    outputs: Array
    stable: NDArray[np.bool_]
    chosen: int

    @property
    def output(self) -> float:
        """Output at the chosen equilibrium, in its unit."""
        return float(self.outputs[self.chosen])

    @property
    def is_stable(self) -> bool:
        """True if the chosen equilibrium is stable."""
        return bool(self.stable[self.chosen])


def equilibrium(model: NarxModel, operating_input: ArrayLike | None = None) -> Equilibrium:
    """Find all real equilibria of a model under a constant input.

    One of them is chosen: the one to which the training data lead. The search starts at the mean of the training
    inputs with the equilibrium nearest to the mean output, and follows this equilibrium while the input changes to the
    operating input. If the model has no training data, zeros take the place of both means.

    Parameters
    ----------
    model : NarxModel
        Identified model.
    operating_input : array_like, shape () or (n_inputs,), optional
        Constant inputs, in their units; the mean of the training inputs by default.

    Raises
    ------
    ModelError
        If the model has several outputs, if it has no real equilibrium or every output is an equilibrium, or if the
        coefficients overflow.
    """
    target = operating_input_of(model, operating_input)
    roots = _real_equilibria(model, target)
    if roots.size == 0:
        inputs = ", ".join(amount(f"{value:.6g}", unit) for value, unit in zip(target, model.input_units, strict=True))
        raise ModelError(f"the model has no real equilibrium at the input {inputs}; its free run cannot settle there")
    poles = [poles_of(*feedback(model, levels(model, target, float(output)))) for output in roots]
    stable = np.array([bool(np.all(np.abs(p) < 1.0)) for p in poles])
    return Equilibrium(
        operating_input=np.array(target), outputs=roots, stable=stable, chosen=_nearest_to_data(model, target, roots)
    )


def _nearest_to_data(model: NarxModel, target: Array, roots: Array) -> int:
    """Follow the equilibrium branch near the data to the target input; return the root where the branch ends."""
    if roots.size == 1:
        return 0
    start = np.zeros_like(target) if model.operating is None else model.operating.input_centre
    near = 0.0 if model.operating is None else float(model.operating.output_centre[0])
    for fraction in np.linspace(0.0, 1.0, _PATH_STEPS, endpoint=False) if np.any(start != target) else ():
        here = _real_equilibria(model, start + fraction * (target - start))
        if here.size:
            near = float(here[np.argmin(np.abs(here - near))])
    return int(np.argmin(np.abs(roots - near)))


def _real_equilibria(model: NarxModel, inputs: Array) -> Array:
    """Return the real roots of f(y, ..., y; u) - y in increasing order."""
    if model.table.functions:
        return _crossings(model, inputs)
    is_output = np.array([v.kind == "y" for v in model.table.variables], dtype=bool)
    degrees = model.table.exponents[:, is_output].sum(axis=1)  # degrees in the output, the unknown of the polynomial
    with np.errstate(over="ignore", invalid="ignore"):
        weights = model.theta * model.table.at(np.where(is_output, 1.0, levels(model, inputs, 0.0)))
    require_finite(weights)
    coefficients = np.bincount(degrees, weights=weights, minlength=2)
    sizes = np.bincount(degrees, weights=np.abs(weights), minlength=2)
    coefficients[1] -= 1.0
    sizes[1] += 1.0
    # Scaled to units of the data, so that the choice of units has no influence; coefficients that cancel to rounding
    # become zero.
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
    return np.unique(real) * scale + model.output_origin[0]


def _crossings(model: NarxModel, inputs: Array) -> Array:
    """Find the y at which f(y, ..., y; u) - y changes sign, increasing, on a grid of twenty outputs per decade."""
    from scipy.optimize import brentq

    def imbalance(y: float) -> float:
        at = levels(model, inputs, y + model.output_origin[0])
        values = [
            x if v.shape is None else v.shape.value(np.asarray(x))
            for v, x in zip(model.table.variables, at, strict=True)
        ]
        return float(model.theta @ model.table.at(np.array(values)) - y)

    half = _output_size(model) * np.logspace(-3, 3, 121)
    tried = np.concatenate([-half[::-1], [0.0], half])
    with np.errstate(over="ignore", invalid="ignore"):
        left = np.array([imbalance(y) for y in tried])
    found = [
        brentq(imbalance, tried[i], tried[i + 1], xtol=1e-14 * half[60])
        for i in np.flatnonzero(left[:-1] * left[1:] < 0)
    ]
    return np.unique([*found, *tried[left == 0.0]]) + model.output_origin[0]


def _output_size(model: NarxModel) -> float:
    if model.operating is None:
        return 1.0
    ends = np.array([model.operating.output_min, model.operating.output_max])
    return float(np.abs(ends - model.output_origin).max()) or 1.0


def _newton(coefficients: Array, roots: Array) -> Array:
    """Refine real roots by three Newton steps, enough after eigenvalues. At a double root no step helps."""
    slope = polynomial.polyder(coefficients)
    for _ in range(3):
        steepness, residual = polynomial.polyval(roots, slope), polynomial.polyval(roots, coefficients)
        moved = roots - np.divide(residual, steepness, out=np.zeros_like(roots), where=steepness != 0)
        nearer = np.abs(polynomial.polyval(moved, coefficients)) < np.abs(residual)
        roots = np.where(nearer, moved, roots)
    return roots


@dataclass(frozen=True, kw_only=True, eq=False)
class Deviations(Frozen):
    """A model of the deviations v = y - ybar and w = u - ubar from an equilibrium, with this equilibrium."""

    model: NarxModel
    jacobian: Array
    point: Equilibrium  # Origin of the deviations

    def seen(self, recording: Recording) -> Recording:
        """Return a recording as deviations from the equilibrium."""
        inputs = recording.inputs - self.point.operating_input[:, None]
        return replace(recording, inputs=inputs, outputs=recording.outputs - self.point.output)


def remove_dc(model: NarxModel, operating_input: ArrayLike | None = None) -> NarxModel:
    """Return the model of the deviations v = y - ybar and w = u - ubar from an equilibrium (ubar, ybar).

    The polynomial is expanded about the equilibrium: parameters change, terms of lower degree appear, and the constant
    term vanishes. (Merely deleting the constant term of a nonlinear model gives a different system.) The free run of
    the new model, plus ybar, equals that of the original model. The covariance of the parameters is propagated
    to first order, including the shift of the equilibrium.

    Parameters
    ----------
    model : NarxModel
        Identified model.
    operating_input : array_like, shape () or (n_inputs,), optional
        Constant inputs ubar, in their units; the mean of the training inputs by default.

    Returns
    -------
    NarxModel
        Model without a constant term. Its ``operating`` range is that of the deviations.

    Raises
    ------
    ModelError
        If the model has no equilibrium at this input, integrates, or has no other term than the constant; if two
        equilibria coincide; or if the coefficients overflow.
    """
    return deviations(model, operating_input).model


def deviations(model: NarxModel, operating_input: ArrayLike | None = None) -> Deviations:
    """Expand a model about an equilibrium. Shapes: `operating_input` ()."""
    polynomial_model(model)
    point = equilibrium(model, operating_input)
    expansion: dict[Term, Array] = defaultdict(lambda: np.zeros(len(model.terms)))
    slope: dict[Term, Array] = defaultdict(lambda: np.zeros(len(model.terms)))
    model_point = point.operating_input - model.input_origin, np.float64(point.output) - model.output_origin[0]
    with np.errstate(over="ignore", invalid="ignore"):
        for m, term in enumerate(model.terms):
            for remaining, share, change in expand(term, *model_point):
                expansion[remaining][m] += share
                slope[remaining][m] += change
    expansion.pop(Term(()), None)
    if not expansion:
        raise ModelError("the model is constant: nothing is left without its operating point")
    terms = tuple(sorted(expansion, key=lambda t: (t.degree, t.factors)))
    matrix = np.array([expansion[term] for term in terms])
    require_finite(matrix)
    moves = motion(model, levels(model, point.operating_input, point.output))
    jacobian = matrix + np.outer(np.array([slope[term] for term in terms]) @ model.theta, moves)
    moved = (
        None if model.operating is None else model.operating.shifted(point.operating_input, np.array([point.output]))
    )
    shifted = replace(
        model,
        terms=terms,
        equations=(),
        theta=matrix @ model.theta,
        theta_cov=transformed(jacobian, model.theta_cov),
        input_origin=np.zeros_like(model.input_origin),
        output_origin=np.zeros_like(model.output_origin),
        operating=moved,
        provenance={**model.provenance, "deviations_from": _written(model, point)},
    )
    return Deviations(model=shifted, jacobian=jacobian, point=point)


def _written(model: NarxModel, point: Equilibrium) -> str:
    values, units = (*point.operating_input, point.output), (*model.input_units, *model.output_units)
    return ", ".join(amount(f"{value:.9g}", unit) for value, unit in zip(values, units, strict=True))


def expand(term: Term, inputs: Array, output: Any) -> Iterator[tuple[Term, Any, Any]]:
    """Expand a term about an equilibrium, as a product of (level + deviation)^power. Shapes: `inputs` (n_inputs,)."""
    parts: list[tuple[tuple[Variable, ...], Any, Any]] = [((), 1.0, 0.0)]
    for variable, power in term.factors:
        is_output = variable.kind == "y"
        level = output if is_output else inputs[variable.index]
        grown = []
        for kept in range(power + 1):
            rest = power - kept
            weight = comb(power, kept) * level**rest
            change = comb(power, kept) * rest * level ** (rest - 1) if is_output and rest else 0.0
            grown += [(factors + (variable,) * kept, w * weight, w * change + d * weight) for factors, w, d in parts]
        parts = grown
    for factors, weight, change in parts:
        yield Term.product(factors), weight, change


@dataclass(frozen=True, kw_only=True, eq=False)
class Removal:
    """A model before and after its DC component is removed, with free runs over held-out data."""

    model: NarxModel
    shifted: Deviations  # Model about the equilibrium at the mean of the training commands
    section: Recording
    run: Array
    shifted_run: Array
    deleted_run: Array  # Free run with the constant term deleted, all others unchanged

    @property
    def error(self) -> float:
        """Largest change of the free run due to the correct removal, relative to its stroke."""
        return float(np.abs(self.shifted_run - self.run).max() / np.ptp(self.run))

    @property
    def deleted_error(self) -> float:
        """Rms change due to deleting the constant, in standard deviations of the run; at most 100."""
        difference = np.nan_to_num(self.deleted_run - self.run, nan=np.inf)
        return min(float(np.sqrt(np.mean(np.clip(difference, -1, 1) ** 2)) / self.run.std()), 100.0)


def remove(model: NarxModel, section: Recording) -> Removal:
    """Remove the DC component correctly and by deletion, and simulate all three models."""
    shifted = deviations(model)
    moved, level = shifted.seen(section), shifted.point.output
    kept = [place for place, term in enumerate(model.terms) if term != Term(())]
    deleted = replace(
        model,
        terms=tuple(model.terms[i] for i in kept),
        theta=model.theta[kept],
        theta_cov=model.theta_cov[np.ix_(kept, kept)],
        equations=(),
        operating=None,
    )
    return Removal(
        model=model,
        shifted=shifted,
        section=section,
        run=model.simulate(section).outputs[0],
        shifted_run=shifted.model.simulate(moved).outputs[0] + level,
        deleted_run=deleted.simulate(moved).outputs[0] + level,
    )
