"""Test by closure: is an unknown force at a place a repeatable function of the signals there?

With one input and one output, forces at several places can explain a residual equally well. At the right place the force
is a simple function of the signal there and of its past, and the same function in all records. So for each place a few
`features` are chosen on one part of the recordings, by orthogonal matching pursuit through the plant's linearised
responses, beside the base parameters. They are judged by the residual of the other part.

References
----------
Pati, Rezaiifar, Krishnaprasad, "Orthogonal matching pursuit", Proc. 27th Asilomar Conference (1993) 40-44,
doi:10.1109/ACSSC.1993.342465.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from deatwin.ident.greybox.filter_linear import Linear
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.locate.features import features, signal_at
from deatwin.ident.mismatch.thresholds import ACCURACY, MOST_TERMS, NEGLIGIBLE, TINY
from deatwin.plant.arrays import Array

FOLDS = 12
"""Number of stretches into which the recordings are cut: features are chosen on every second one and judged on the
others, and vice versa."""
STEPS = 1500
"""Largest number of means of samples on which features are chosen."""
SHIFTS = 99


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """A residual, and regressors at one place."""

    residual: Array  # (n,), means over some samples of measured minus simulated, SI
    parameters: Array  # (n, n_p), responses to the base parameters, of length one
    answers: Array  # (n, n_features), responses to the features, of length one
    fold: NDArray[np.int_]  # (n,), number of the stretch
    readings: int  # number of samples in a mean

    @cached_property
    def halves(self) -> tuple[Half, Half]:
        """Even and odd folds."""
        return Half.of(self, 0), Half.of(self, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Half:
    """Regressors on every second stretch, prepared for a choice of features."""

    learn: NDArray[np.bool_]  # (n,), samples of these stretches
    basis: Array  # (n/2, n_p), orthonormal, of the responses to the base parameters
    free: Array  # (n/2, n_features), part of the answers that the parameters cannot explain
    lengths: Array  # (n_features,), of the answers

    @classmethod
    def of(cls, regression: Regression, odd: int) -> Half:
        learn = regression.fold % 2 == odd
        basis, answers = tangent_basis(regression.parameters[learn]), regression.answers[learn]
        return cls(learn=learn, basis=basis, free=taken_off(answers, basis), lengths=np.linalg.norm(answers, axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Closure:
    """Share of the residual that a function of the signals at a place predicts on other data."""

    losses: Array  # (n,), squared errors of the prediction, SI
    closed: Array  # (n,), likewise with the base parameters alone
    count: int  # number of features of the function

    @property
    def explained(self) -> float:
        """R² against the base parameters alone; negative where the function is not repeatable."""
        return float(1 - self.losses.mean() / max(float(self.closed.mean()), TINY))


def regressions(linears: Sequence[Linear]) -> tuple[Regression, ...]:
    """Return one regression for each opening of the linearised plant along the recordings."""
    size = -(-sum(int(linear.counted.sum()) for linear in linears) // STEPS)
    residual = np.concatenate([_means(linear.residual[linear.counted], size) for linear in linears])
    parameters = np.concatenate([_means(linear.parameter_response()[linear.counted], size) for linear in linears])
    fold = np.arange(residual.size) * FOLDS // residual.size
    found, courses = [], dict[str, list[Array]]()
    for number, opening in enumerate(linears[0].openings):
        signal = signal_at(linears[0], opening)  # most places have the same signal
        if signal not in courses:
            courses[signal] = [features(linear, opening) for linear in linears]
        pieces = [linear.response(number, course) for linear, course in zip(linears, courses[signal], strict=True)]
        answers = [_means(piece[linear.counted], size) for piece, linear in zip(pieces, linears, strict=True)]
        found.append(
            Regression(
                residual=residual,
                parameters=_of_length_one(parameters),
                answers=_of_length_one(np.concatenate(answers)),
                fold=fold,
                readings=size,
            )
        )
    return tuple(found)


def closure(regression: Regression, shift: int = 0) -> Closure:
    """Fit on each half of the folds and judge on the other, with the number of features that predicts best.

    The residual is shifted cyclically by `shift` samples.
    """
    residual = np.roll(regression.residual, shift)
    losses = np.empty((MOST_TERMS + 1, residual.size))
    for half in regression.halves:
        learn = half.learn
        chosen = _pursuit(residual[learn], half)
        columns = np.hstack([regression.parameters, regression.answers[:, chosen]])
        for count, weights in enumerate(_nested_fits(columns[learn], residual[learn], len(chosen))):
            errors = residual[~learn] - columns[~learn, : weights.size] @ weights
            losses[count, ~learn] = errors**2
        losses[len(chosen) + 1 :, ~learn] = losses[len(chosen), ~learn]
    count = int(np.argmin(losses.mean(axis=1)))
    return Closure(losses=losses[count], closed=losses[0], count=count)


def closure_p_value(regressions_: Sequence[Regression], rng: np.random.Generator) -> float:
    """Return the chance, at least 1/100, that a residual independent of the signals is predicted as well at any place."""
    # The residual is shifted cyclically by random times, which preserves its own correlation.
    observed = max(closure(regression).explained for regression in regressions_)
    n = regressions_[0].residual.size
    reached = 0
    for shift in rng.integers(n // 10, n - n // 10, SHIFTS):
        reached += max(closure(regression, shift).explained for regression in regressions_) >= observed
    return (1 + reached) / (1 + SHIFTS)


def _pursuit(residual: Array, half: Half) -> list[int]:
    """Return the features in the order in which each most reduces the residual."""
    left, new = taken_off(residual, half.basis), half.free
    chosen: list[int] = []
    while True:
        length = np.linalg.norm(new, axis=0)
        fresh = length > NEGLIGIBLE * half.lengths
        gains = np.where(fresh, np.abs(new.T @ left) / np.where(fresh, length, 1.0), 0.0)
        best = int(np.argmax(gains))
        if not gains[best] > 0:
            return chosen
        chosen.append(best)
        if len(chosen) == MOST_TERMS:
            return chosen
        direction = new[:, best] / length[best]
        left = left - direction * (direction @ left)
        new = new - direction[:, None] * (direction @ new)


def _nested_fits(columns: Array, target: Array, count: int) -> list[Array]:
    """Return least-squares fits without the last `count` columns, then with one more column at a time."""
    first = columns.shape[1] - count
    # A small diagonal keeps the fit regular if two parameters act alike.
    steady = np.vstack([columns, ACCURACY * np.eye(columns.shape[1])])
    q, r = np.linalg.qr(steady)
    seen = q[: target.size].T @ target
    return [solve_triangular(r[:k, :k], seen[:k], check_finite=False) for k in range(first, columns.shape[1] + 1)]


def _means(values: Array, size: int) -> Array:
    """Return means of blocks of samples; an incomplete block at the end is dropped."""
    count = values.shape[0] // size
    return np.asarray(values[: count * size].reshape(count, size, *values.shape[1:]).mean(axis=1))


def _of_length_one(columns: Array) -> Array:
    lengths = np.linalg.norm(columns, axis=0)
    return columns / np.where(lengths > 0, lengths, 1.0)
