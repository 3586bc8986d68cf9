"""A long ARX regression of an output on lagged inputs, and what its coefficients tell from chance.

The regression A y(k) = sum_i B_i u_i(k) + e(k) with many lags whitens the noise, whatever its colour and whether or
not the input answers to the output, and B_i begins where the plant from u_i does: 1/H, with H the model of the noise,
begins with 1. The tests hold under noise whose size changes with the input, as that which a wrong linear model
leaves (White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48 (1980) 817-838,
doi:10.2307/1912934).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LongArx", "Signals", "n_residuals"]

Array = NDArray[np.float64]
Signals = Sequence[tuple[Array, Array]]
"""Inputs, (n_inputs, n), and output, (n,), of each recording, scaled to a variance of 1."""

_OUTPUT_LAGS = 30
"""Most lags of the output; Akaike's criterion takes what is needed of them."""
_FUTURE = 5
"""Samples after the present one in which the input may betray that it answers to the output."""
_RESOLVED = 1e-9
"""Share of the output below which a residual is rounding: readings have at most nine digits that mean anything."""


@dataclass(frozen=True, eq=False)
class LongArx:
    """The regression on the lags 0 to `longest` of each input.

    Parameters
    ----------
    signals : sequence of (ndarray, ndarray)
        Of each recording.
    longest : int
        Largest lag of the inputs.
    n_output_lags : int
        Lags 1 to this of the output.
    a : ndarray, shape (n_output_lags + 1,)
        A, from q^0 on.
    b : ndarray, shape (n_inputs, longest + 1)
        B of each input.
    b_std : ndarray, shape (n_inputs, longest + 1)
        Standard deviation of each coefficient.
    variance : float
        Of e.
    n_samples : int
        Number of residuals.
    """

    signals: Signals
    longest: int
    n_output_lags: int
    a: Array
    b: Array
    b_std: Array
    variance: float
    n_samples: int

    @property
    def n_unknowns(self) -> int:
        """Number of coefficients."""
        return 1 + self.n_output_lags + self.b.size

    @staticmethod
    def most_unknowns(n_inputs: int, longest: int) -> int:
        """Number of coefficients with the most lags of the output.

        Parameters
        ----------
        n_inputs, longest : int
            Number of inputs, and their largest lag.
        """
        return 1 + _OUTPUT_LAGS + n_inputs * (longest + 1) + _FUTURE

    @classmethod
    def of(cls, signals: Signals, longest: int) -> LongArx:
        """Fit it by least squares; of collinear regressors the shortest solution.

        Parameters
        ----------
        signals : sequence of (ndarray, ndarray)
            Of each recording.
        longest : int
            Largest lag of the inputs.
        """
        n_inputs = signals[0][0].shape[0]
        inputs = [_inputs(signals, i, range(longest, -1, -1)) for i in range(n_inputs)]
        past, target = _outputs(signals, longest)
        order = _order(np.column_stack([np.ones(target.size), *inputs, past, target]), 1 + n_inputs * (longest + 1))
        rows = np.column_stack([np.ones(target.size), past[:, :order], *inputs])
        scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        left, singular, right = np.linalg.svd(rows / scale, full_matrices=False)
        kept = singular > 1e-10 * singular[0]
        inverse = right[kept].T / singular[kept]
        theta = inverse @ (left[:, kept].T @ target) / scale
        error = target - rows @ theta
        variance = max(float(error @ error) / (target.size - rows.shape[1]), _RESOLVED**2)
        std = np.sqrt(variance * np.sum(inverse**2, axis=1)) / scale
        shape = (n_inputs, longest + 1)
        return cls(
            signals, longest, order, np.r_[1.0, -theta[1 : order + 1]], theta[order + 1 :].reshape(shape)[:, ::-1],
            std[order + 1 :].reshape(shape)[:, ::-1], variance, target.size,
        )  # fmt: skip

    def chances(self, which: int) -> tuple[Array, float]:
        """How probable it is that chance makes the input's first coefficients, and that the output moves the input.

        Parameters
        ----------
        which : int
            Row of the input.

        Returns
        -------
        zero : ndarray, shape (longest + 1,)
            At d the p-value of "the input does not act at the lags 0 to d".
        feedback : float
            The p-value of "given the past, the output does not foretell the next five inputs", in which an input that
            does not answer to the output is told by its own past (Sims, "Money, income, and causality", Am. Econ. Rev.
            62 (1972) 540-552).
        """
        n_inputs = self.b.shape[0]
        lags = range(self.longest, -_FUTURE - 1, -1)
        others = [_inputs(self.signals, i, range(self.longest + 1)) for i in range(n_inputs) if i != which]
        past, target = _outputs(self.signals, self.longest)
        own = _inputs(self.signals, which, lags)
        rows = np.column_stack([np.ones(target.size), past[:, : self.n_output_lags], *others, own])
        q, _ = np.linalg.qr(rows)
        last = q[:, -own.shape[1] :]
        score = last.T @ target
        error = target - q @ (q.T @ target)
        freedom = target.size - rows.shape[1]
        weight = error**2 * (target.size / freedom) + _RESOLVED**2
        spread = last.T @ (weight[:, None] * last)
        present = score.size - _FUTURE
        before = [_p_value(score, spread, slice(present - d - 1, present), freedom) for d in range(self.longest + 1)]
        return np.array(before), _p_value(score, spread, slice(present, None), freedom)


def n_residuals(signals: Signals, longest: int) -> int:
    """Return the number of samples whose lags and next inputs are all measured.

    Parameters
    ----------
    signals : sequence of (ndarray, ndarray)
        Of each recording.
    longest : int
        Largest lag of the inputs.
    """
    return sum(max(0, output.size - _first(longest) - _FUTURE) for _, output in signals)


def _p_value(score: Array, spread: Array, part: slice, freedom: int) -> float:
    """Wald's test of a part of the scores, by Hotelling's law since their covariance is estimated too."""
    from scipy.special import fdtrc

    size = score[part].size
    square = float(score[part] @ np.linalg.solve(spread[part, part], score[part]))
    return float(fdtrc(size, freedom - size + 1, square * (freedom - size + 1) / (size * freedom)))


def _order(columns: Array, fixed: int) -> int:
    """Number of output lags by Akaike's criterion: the triangle has the residual of each number of columns."""
    last = np.linalg.qr(columns, mode="r")[:, -1] ** 2
    squares = np.cumsum(last[::-1])[::-1][fixed:-1]  # with 0, 1, ... lags of the output
    n = columns.shape[0]
    squares = np.maximum(squares, n * _RESOLVED**2)
    return int(np.argmin(n * np.log(squares) + 2.0 * np.arange(squares.size)))


def _first(longest: int) -> int:
    return max(longest, _OUTPUT_LAGS)


def _inputs(signals: Signals, which: int, lags: range) -> Array:
    """An input at some lags, negative ones being the future, shape (n, n_lags)."""
    first = _first(max(lags))
    return np.concatenate([
        np.column_stack([inputs[which, first - lag : inputs.shape[1] - _FUTURE - lag] for lag in lags])
        for inputs, _ in signals
    ])  # fmt: skip


def _outputs(signals: Signals, longest: int) -> tuple[Array, Array]:
    """The output at the lags 1 to 30, shape (n, 30), and the output, shape (n,)."""
    first, lags = _first(longest), range(1, _OUTPUT_LAGS + 1)
    past = [np.column_stack([y[first - lag : y.size - _FUTURE - lag] for lag in lags]) for _, y in signals]
    return np.concatenate(past), np.concatenate([y[first : y.size - _FUTURE] for _, y in signals])
