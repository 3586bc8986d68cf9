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
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.thresholds import ACCURACY, MOST_TERMS, NEGLIGIBLE, TINY
from deatwin.plant.arrays import Array
from deatwin.plant.effects.base import Place

TIMES = 8
"""Number of time constants of the low passes, from two samples to a third of the record."""
HINGES = (0.5, 0.75, 0.9, 0.97)
"""Quantiles of a signal at which a characteristic may bend."""
PLAYS = (0.01, 0.03, 0.1, 0.3)
"""Half widths of the play operators, as shares of the signal's range."""
STEEP = (0.1, 0.5)
"""Rates over which friction changes its sign, in standard deviations of the rate."""


def features(linear: Linear, opening: Opening) -> Array:
    """Return dimensionless features, (n, n_features), of which a combination may be what enters at a place."""
    # What enters at the drive can depend only on the command and its past; what enters elsewhere, on the motion and its
    # past, as the reading shows it. The features are polynomials and hinges of that signal, low passes of it and of its
    # square, and the square of the former, play operators (rate-independent memory), friction and drag of its rate; and
    # the clock.
    values = linear.states[signal_at(linear, opening)]
    signal = values / max(float(np.abs(values).max()), TINY)
    times = np.geomspace(2.0, max(signal.size / 3, 4.0), TIMES)
    clock = np.arange(signal.size)[:, None]
    columns = [
        np.ones((signal.size, 1)),
        1 - np.exp(-clock / times[TIMES // 2 :]),
        signal[:, None] ** np.arange(1, 4),
        np.maximum(signal[:, None] - np.quantile(signal, HINGES), 0.0),
        *(_past(signal, time) for time in times),
        np.stack([play(signal, share * np.ptp(signal)) for share in PLAYS], axis=1),
        _of_rate(signal),
    ]
    return np.hstack(columns)


def signal_at(linear: Linear, opening: Opening) -> str:
    """Return the name of the signal on which the unknown input at a place can depend."""
    rig = linear.plant.rig
    return rig.input_name if opening.place == Place.DRIVE.value else rig.output_name


def _past(signal: Array, time: float) -> Array:
    """Return low passes of a signal and of its square, and the square of the first; `time` in samples."""
    from scipy.signal import lfilter

    kept = np.exp(-1 / time)
    first, second = (
        lfilter([1 - kept], [1.0, -kept], course - course[0]) + course[0] for course in (signal, signal**2)
    )
    return np.stack([first, second, first**2], axis=1)


def play(signal: Array, width: float) -> Array:
    """Apply the play operator: the output follows the signal only when pushed by an end of the slot."""
    moved, at = [], float(signal[0])
    for value in signal.tolist():
        at = min(max(at, value - width), value + width)
        moved.append(at)
    return np.array(moved)


def _of_rate(signal: Array) -> Array:
    rate = np.gradient(signal)
    rate = rate / max(float(rate.std()), TINY)
    friction = [np.tanh(rate / steep) for steep in STEEP]
    return np.stack([rate, rate * np.abs(rate), *friction], axis=1)


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
