"""Frequency responses of one structure at many parameters at once, as for draws of a posterior.

The equilibrium is followed from the model's own in small steps of the parameters; where its branch ends, there is none.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.dc import Equilibrium, expand
from deatwin.ident.frequency.hierarchy import Jet, Orders, blocks_of, solve_parts
from deatwin.ident.frequency.linear import levels
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Frozen

_BLOCK = 16384  # values in a block of draws, which fits into the processor's cache
_MOST = 2048  # frequencies in a block
_STEPS = 4  # steps from the model's own parameters to those of a draw
_NEWTON = 12
_BETWEEN = 9  # points between two outputs at which the slope is checked for an extremum
_SETTLED = 1e-9  # largest residual of the equilibrium equation, relative to its terms


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated(Frozen):
    """A frequency response, computed for many parameter vectors."""

    values: Complex  # shape (n_draws, n): Response of each draw; NaN if there is no equilibrium
    exists: NDArray[np.bool_]  # shape (n_draws,): True if there is an equilibrium
    stable: NDArray[np.bool_]  # shape (n_draws,): True if it is stable


Many = Callable[[Array], Evaluated]  # Response of each parameter vector, shape (n_draws, n_terms)


def then(evaluate: Many | None, change: Callable[[Complex], Complex]) -> Many | None:
    """Return a function of many parameters whose values are changed afterwards."""
    return None if evaluate is None else partial(_changed, evaluate, change)


def _changed(evaluate: Many, change: Callable[[Complex], Complex], thetas: Array) -> Evaluated:
    found = evaluate(thetas)
    return replace(found, values=change(found.values))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Many:
    """Models of deviations from equilibrium, for those draws that have an equilibrium."""

    terms: Sequence[Term]
    theta: Array  # shape (n_terms, n_kept): Parameters of the models
    exists: NDArray[np.bool_]  # shape (n_draws,): True for draws that have an equilibrium
    stable: NDArray[np.bool_]  # shape (n_draws,): True for draws that have a stable one


def gfrf_of_many(model: NarxModel, point: Equilibrium, rows: Sequence[int], angles: Array, thetas: Array) -> Evaluated:
    """Compute H_n at many parameters. Shapes: `angles` (n, order); `thetas` (n_draws, n_terms)."""
    many = _deviations(model, point, thetas)
    shape, blocks = blocks_of(angles, _MOST, rows)
    values = np.full((len(thetas), *shape), np.nan + 0j)
    beside = (1,) * (len(shape) - 1)
    for block, tones in blocks:
        for draws, theta in _blocks(many, values[0][block].size):
            wide = theta.reshape(*theta.shape, *beside)
            part = solve_parts(many.terms, wide, tones, by_theta=False).get(tones.whole)
            place: tuple[Any, ...] = (draws, *block)
            values[place] = _or_zero(part) / tones.repeats
    return Evaluated(values=values.reshape(len(thetas), -1), exists=many.exists, stable=many.stable)


def spectrum_of_many(
    model: NarxModel, point: Equilibrium, parts: Orders, wanted: Sequence[int], thetas: Array
) -> Evaluated:
    """Compute a sum of orders of the output's spectrum at many parameters. Shapes: `thetas` (n_draws, n_terms)."""
    many = _deviations(model, point, thetas)
    n = parts.n_samples
    values = np.full((len(thetas), n // 2 + 1), np.nan + 0j)
    for draws, theta in _blocks(many, n):
        found = solve_parts(many.terms, theta, parts, by_theta=False)
        output = sum((_or_zero(found.get(order)) for order in wanted), start=np.zeros(n))
        values[draws] = np.fft.rfft(output) / n
    return Evaluated(values=values, exists=many.exists, stable=many.stable)


def stable_polynomials(coefficients: Array) -> NDArray[np.bool_]:
    """True where all roots lie inside the unit circle (Schur, Cohn). Shapes: (..., order + 1); returns (...)."""
    rest = np.asarray(coefficients, dtype=np.float64)
    stable = np.ones(rest.shape[:-1], dtype=np.bool_)
    while rest.shape[-1] > 1:
        last = rest[..., -1:]
        stable &= np.abs(last[..., 0]) < 1.0
        safe = np.where(np.abs(last) < 1.0, last, 0.0)
        rest = (rest - safe * rest[..., ::-1])[..., :-1] / (1.0 - safe**2)
    return stable


def _or_zero(jet: Jet | None) -> Array:
    return np.zeros(1) if jet is None else jet.value


def _blocks(many: _Many, n: int) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Split the draws that have an equilibrium; yield their positions and parameters."""
    kept, size = np.flatnonzero(many.exists), max(1, _BLOCK // n)
    for first in range(0, kept.size, size):
        yield kept[first : first + size], many.theta[:, first : first + size]


def _deviations(model: NarxModel, point: Equilibrium, thetas: Array) -> _Many:
    """Expand the model at the equilibrium of each parameter vector, like `deatwin.ident.frequency.dc.deviations`."""
    outputs, exists = follow_equilibrium(model, point, thetas)
    theta, outputs = thetas[exists].T, outputs[exists]
    inputs = point.operating_input - model.input_origin
    expansion: dict[Term, Array] = defaultdict(lambda: np.zeros(outputs.size))
    for m, term in enumerate(model.terms):
        for remaining, share, _ in expand(term, inputs, outputs - model.output_origin[0]):
            expansion[remaining] += share * theta[m]
    expansion.pop(Term(()), None)
    terms = tuple(sorted(expansion, key=lambda t: (t.degree, t.factors)))
    stable = np.zeros(len(thetas), dtype=np.bool_)
    stable[exists] = stable_polynomials(_feedback_polynomial(expansion, outputs.size))
    return _Many(terms=terms, theta=np.array([expansion[term] for term in terms]), exists=exists, stable=stable)


def _feedback_polynomial(expansion: dict[Term, Array], count: int) -> Array:
    """1 - sum_l a_l q^-l of each, shape (count, largest lag + 1)."""
    linear = {t.expanded[0].lag: a for t, a in expansion.items() if t.degree == 1 and t.expanded[0].kind == "y"}
    polynomial = np.zeros((count, max(linear, default=0) + 1))
    polynomial[:, 0] = 1.0
    for lag, a in linear.items():
        polynomial[:, lag] -= a
    return polynomial


def follow_equilibrium(model: NarxModel, point: Equilibrium, thetas: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Follow the equilibrium to other parameters by Newton's method. Shapes: `thetas` (n_draws, n_terms)."""
    # If y - f(y) has an extremum between two roots, the model's own branch has ended in a fold, and the new root
    # belongs to another branch.
    is_output = np.array([v.kind == "y" for v in model.table.variables], dtype=bool)
    degrees = model.table.exponents[:, is_output].sum(axis=1)
    weights = model.table.at(np.where(is_output, 1.0, levels(model, point.operating_input, 0.0)))
    powers = np.arange(int(degrees.max(initial=0)) + 1)
    collect = (degrees == powers[:, None]) * weights  # coefficients of f, a polynomial in the output, by term
    origin = model.output_origin[0]  # origin of the outputs that are used here
    outputs, follows = np.full(len(thetas), point.output - origin), np.ones(len(thetas), dtype=np.bool_)
    start, way = collect @ model.theta, (thetas - model.theta) @ collect.T
    with np.errstate(all="ignore"):
        for share in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
            coefficients, before = start + share * way, outputs
            for _ in range(_NEWTON):
                residual, stiffness, size = _equation(coefficients, powers, outputs)
                outputs = outputs - residual / stiffness
                if np.all(np.abs(residual) <= _SETTLED * size):
                    break
            residual, _, size = _equation(coefficients, powers, outputs)
            follows &= np.isfinite(outputs) & (np.abs(residual) <= _SETTLED * size)
            follows &= ~_extremum_between(coefficients, powers, before, outputs)
    return outputs + origin, follows


def _extremum_between(coefficients: Array, powers: NDArray[np.int64], first: Array, last: Array) -> NDArray[np.bool_]:
    """Return whether y - f(y) has an extremum between two outputs."""
    if powers.size < 3:  # linear in the output
        return np.zeros(first.size, dtype=np.bool_)
    shares = np.linspace(0.0, 1.0, _BETWEEN)
    falls = np.array([_equation(coefficients, powers, first + s * (last - first))[1] < 0 for s in shares])
    return np.asarray(np.any(falls != falls[0], axis=0))


def _equation(coefficients: Array, powers: NDArray[np.int64], outputs: Array) -> tuple[Array, Array, Array]:
    """Return y - f(y), its slope, and the size of its terms."""
    residual, stiffness, size = outputs.copy(), np.ones_like(outputs), np.abs(outputs)
    for power, coefficient in zip(powers, coefficients.T, strict=True):
        term = coefficient * outputs**power
        residual -= term
        size += np.abs(term)
        if power:
            stiffness -= power * coefficient * outputs ** (power - 1)
    return residual, stiffness, size
