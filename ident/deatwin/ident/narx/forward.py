"""Forward selection by orthogonal least squares, and criteria for the number of terms: information, free-run error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.evidence import log_prior
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.response import DIVERGED
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_DEPENDENT = 1e-20  # share of its squared norm left to a candidate that depends on the chosen ones: six digits
# Norms and products are updated until that of a candidate, or of the output, has fallen to this share, and then
# recomputed, so that cancellation never costs more than two digits.
_REFRESH = 1e-2
_EQUAL = 1.0 - 1e-12  # ratio above which gains differ only by rounding; the first such candidate is taken
_ROWS = 64  # rows orthogonalised at once: 5 MB for 10,000 samples


@dataclass(frozen=True, kw_only=True)
class SelectionStep:
    """One choice of a forward selection."""

    candidate: int  # Position of the chosen row
    err: float  # Error reduction ratio: the share of y'y that the candidate explains
    residual: float  # Residual sum of squares, square of the output's unit


def forward_selection(
    rows: Array, target: Array, max_terms: int, *, given: Array | None = None
) -> Iterator[SelectionStep]:
    """Choose rows one by one by the error reduction ratio (Chen, Billings, Luo, Int. J. Control 50 (1989) 1873-1896).

    Shapes: `rows` (n_candidates, n_samples); `target` (n_samples,); `given` (n_given, n_samples).
    """
    power = float(target @ target)
    sizes = np.einsum("ij,ij->i", rows, rows)
    count = 0 if given is None else len(given)
    limit = min(count + max_terms, target.size)
    basis = np.empty((limit, target.size))
    if given is not None:
        basis[:count] = np.linalg.qr(given.T)[0].T
    left = _orthogonal(target, basis[:count])
    norms, products = _renew(rows, np.arange(len(rows)), basis[:count], left)
    reference, square = norms.copy(), float(left @ left)
    free = np.ones(len(rows), dtype=bool)
    while count < limit:
        usable = free & (norms > _DEPENDENT * sizes)
        if not usable.any() or square == 0.0:
            return
        gain = np.divide(products**2, norms, out=np.full(norms.size, -1.0), where=usable)
        best = int(np.argmax(gain >= _EQUAL * gain.max()))
        free[best] = False
        direction = _orthogonal(rows[best], basis[:count])
        direction /= np.linalg.norm(direction)
        basis[count] = direction
        count += 1
        explained = float(direction @ left)
        left -= explained * direction
        yield SelectionStep(candidate=best, err=explained**2 / power, residual=float(left @ left))
        along = rows @ direction
        norms -= along**2
        products -= explained * along
        stale = np.flatnonzero(free & (norms < _REFRESH * reference))
        norms[stale], products[stale] = _renew(rows, stale, basis[:count], left)
        reference[stale] = norms[stale]
        if float(left @ left) < _REFRESH * square:
            products, square = rows @ left, float(left @ left)


def _renew(rows: Array, which: NDArray[np.intp], basis: Array, left: Array) -> tuple[Array, Array]:
    """Replace rows by their parts orthogonal to a basis; return their squared norms and products with the residual."""
    norms, products = np.empty(which.size), np.empty(which.size)
    for start in range(0, which.size, _ROWS):
        part = slice(start, start + _ROWS)
        some = rows[which[part]]
        if len(basis):
            some = rows[which[part]] = _orthogonal(some, basis)
        norms[part], products[part] = np.einsum("ij,ij->i", some, some), some @ left
    return norms, products


def _orthogonal(vectors: Array, basis: Array) -> Array:
    """Return the parts of row vectors that are orthogonal to the orthonormal rows of a basis; two passes suffice."""
    once = vectors - (vectors @ basis.T) @ basis
    return np.asarray(once - (once @ basis.T) @ basis, dtype=np.float64)


CRITERIA: Mapping[str, Callable[[float, int, int, int], float]] = MappingProxyType(
    {
        # s mean squared residual, n samples, k terms, p candidates
        "ebic": lambda s, n, k, p: n * log(s) + k * log(n) - 2 * log_prior(k, p),
        "bic": lambda s, n, k, p: n * log(s) + k * log(n),
        "aic": lambda s, n, k, p: n * log(s) + 2 * k,
    }
)
"""Criteria of a selection path, all on the scale of n ln(mean square); the smallest value is best."""


def criterion_values(name: str, steps: Sequence[SelectionStep], target: Array, candidates: int) -> Array:
    """Return the value of a criterion after each selection step. Shapes: `target` (n_samples,); returns (n_steps,)."""
    n = target.size
    # A residual at rounding level carries no information and must not justify further terms.
    floor = float(np.finfo(float).eps ** 2 * (target @ target)) / n
    return np.array(
        [CRITERIA[name](max(step.residual / n, floor), n, k, candidates) for k, step in enumerate(steps, start=1)]
    )


def split(
    recordings: Sequence[Recording], share: float, first: int
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Split recordings into a first part for training and a last for testing, each longer than `first` lags."""
    training, held_out = [], []
    for number, record in enumerate(recordings, start=1):
        cut = record.n_samples - round(share * record.n_samples)
        if min(cut, record.n_samples - cut) <= first:
            raise ModelError(
                f"recording {number} has {record.n_samples} samples: with held_out = {share:g} one of its parts is "
                f"too short for lags up to {first}"
            )
        training.append(record.section(0, cut))
        held_out.append(record.section(cut, record.n_samples))
    return tuple(training), tuple(held_out)


def free_run_errors(data: Regression, recordings: Sequence[Recording], theta: Array) -> Array:
    """Return mean squared free-run errors (n_models,) of one equation; other outputs are taken as measured."""
    chosen = np.tile(np.arange(theta.shape[1]), (len(theta), 1))
    errors = march_over(data, recordings).squared_errors(chosen, theta, limit=DIVERGED)
    return errors.sum(axis=1) / sum(record.n_samples - data.first for record in recordings)


def march_over(data: Regression, recordings: Sequence[Recording]) -> March:
    """Return the march of one equation over recordings, with other outputs as measured."""
    inputs, outputs = (
        np.concatenate(each, axis=1) for each in zip(*(data.scaled(record) for record in recordings), strict=True)
    )
    return March.of(
        data.scaled_table.terms,
        {"u": inputs, "y": outputs},
        "y",
        outputs[[data.output]],
        first=data.first,
        alone=data.output,
        ends=np.cumsum([record.n_samples for record in recordings]),
    )
