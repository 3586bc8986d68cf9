"""A long ARX regression of an output on lagged inputs, and what its coefficients tell from chance.

A regression A y(k) = sum_i B_i u_i(k) + e(k) with many lags whitens noise of any colour, also in a loop, and B_i begins
where the plant from u_i does, because the inverse of the noise model begins with 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.repeats import periods_apart
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording

Signals = Sequence[tuple[Array, Array]]
"""Inputs, (n_inputs, n), and output, (n,), of each recording, scaled to a variance of 1."""

_OUTPUT_LAGS = 30  # Most lags of the output, of which Akaike's criterion chooses some; never more than of the inputs
_ANSWERS = 10  # Lags of the output from which an input that responds to it is predicted: more make the test weaker
_MOST_SAMPLES = 20_000  # Most samples that are used: more add no certainty, and a regression takes a second
FOR_EACH = 5  # Least samples per unknown: with fewer, unknowns take up the residual's variance and spoil all tests
RESOLVED = 1e-9  # Share of the output below which a residual is rounding: readings have at most nine significant digits

_ALL_LAGS = 1e-4  # p-value below which all lags of an input together act
# Variance of a coefficient, relative to that under a white input, from which lags are too similar. Held, slow and binary
# inputs have twenty to eighty, band-limited ones and a few sines a million and more.
_ALIKE = 1e4


@dataclass(frozen=True, eq=False)
class LongArx:
    """ARX regression on the lags `shortest` to `longest` of each input."""

    signals: Signals
    shortest: tuple[int, ...]  # Smallest lag of each input
    longest: int  # Largest lag of all
    n_output_lags: int  # Number of lags of the output, from lag 1 on
    a: Array  # shape (n_output_lags + 1,): Coefficients of A, from q^0 on
    b: Array  # shape (n_inputs, longest + 1): Coefficients of each B, from lag 0 on; zero before the shortest lag
    variance: float

    def lags(self, which: int) -> range:
        """Lags of an input, the largest first, so that each test shows what a shorter lag adds to the longer ones."""
        return range(self.longest, self.shortest[which] - 1, -1)

    @property
    def n_unknowns(self) -> int:
        """Number of coefficients."""
        return 1 + self.n_output_lags + sum(len(self.lags(i)) for i in range(self.b.shape[0]))

    @classmethod
    def of(cls, signals: Signals, longest: int, *, shortest: Sequence[int]) -> LongArx:
        """Fit by least squares, with the shortest solution for collinear regressors; `shortest` lag of each input."""
        inputs = [_inputs(signals, i, range(longest, first - 1, -1)) for i, first in enumerate(shortest)]
        past, target = _outputs(signals, longest)
        sizes = [columns.shape[1] for columns in inputs]
        order = _order(np.column_stack([np.ones(target.size), *inputs, past, target]), 1 + sum(sizes))
        rows = np.column_stack([np.ones(target.size), past[:, :order], *inputs])
        scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        left, singular, right = np.linalg.svd(rows / scale, full_matrices=False)
        kept = singular > 1e-10 * singular[0]
        theta = right[kept].T / singular[kept] @ (left[:, kept].T @ target) / scale
        error = target - rows @ theta
        variance = max(float(error @ error) / (target.size - rows.shape[1]), RESOLVED**2)
        tested = np.split(theta[order + 1 :], np.cumsum(sizes)[:-1])
        b = np.array([np.pad(one[::-1], (first, 0)) for one, first in zip(tested, shortest, strict=True)])
        a = np.r_[1.0, -theta[1 : order + 1]]
        return cls(signals, tuple(shortest), longest, order, a, b, variance)

    def hides(self, which: int) -> bool:
        """Return whether an input acts although its lags are too similar for any of them to be significant alone."""
        from scipy.special import fdtrc

        others = self._others(which)
        past, target = _outputs(self.signals, self.longest)
        q, _ = np.linalg.qr(np.column_stack([np.ones(target.size), past[:, : self.n_output_lags], *others]))
        own = _inputs(self.signals, which, self.lags(which))
        left, singular, right = np.linalg.svd(own - q @ (q.T @ own), full_matrices=False)
        kept = singular > 1e-10 * np.sqrt(target.size)
        inflation = np.sum((right.T / np.maximum(singular, 1e-10 * np.sqrt(target.size))) ** 2, axis=1) * target.size
        score, size = left[:, kept].T @ target, int(kept.sum())
        freedom = target.size - q.shape[1] - size
        error = float(np.sum((target - q @ (q.T @ target)) ** 2) - score @ score) / freedom + RESOLVED**2
        chance = fdtrc(size, freedom, float(score @ score) / (size * error)) if size else 1.0
        return bool(chance < _ALL_LAGS and np.median(inflation) > _ALIKE)

    def chances(self, which: int) -> Array:
        """Return p-values, (longest + 1,), of "input `which` does not act at this lag, nor at shorter ones"."""
        past, target = _outputs(self.signals, self.longest)
        own = _inputs(self.signals, which, self.lags(which))
        rows = np.column_stack([np.ones(target.size), past[:, : self.n_output_lags], *self._others(which), own])
        test = _Scores.of(rows, target, own.shape[1])
        found = np.ones(self.longest + 1)
        found[list(self.lags(which))] = [test.p_value(slice(i, i + 1)) for i in range(own.shape[1])]
        return found

    def _others(self, which: int) -> list[Array]:
        """Return the lagged other inputs."""
        return [_inputs(self.signals, i, self.lags(i)) for i in range(self.b.shape[0]) if i != which]


def first_samples(recordings: Sequence[Recording], most: int = _MOST_SAMPLES) -> list[Recording]:
    """Return the beginnings of recordings, the same share of each, with at most so many samples in all."""
    share = min(1.0, most / sum(record.n_samples for record in recordings))
    return [record.section(0, max(1, round(share * record.n_samples))) for record in recordings]


def answer_chance(signals: Signals, which: int, longest: int) -> float:
    """Return the p-value of "the input does not respond to the output": given the past of all inputs, the output's past
    must not predict an input that is independent of it (Granger, Econometrica 37 (1969) 424-438). An input with noise, or
    with a cause that is not recorded, is predicted, too. A held input is tested only where it may change, because a
    ringing output reveals how long it has been held, and a repeating one by the differences between its periods. These
    may be noise alone, so a response within the sample must be compatible neither with an input that acts within the
    sample, as estimated from what repeats, nor with one that does not."""
    n_inputs = signals[0][0].shape[0]
    apart = [periods_apart(inputs[which], inputs, output, longest) for inputs, output in signals]
    signals = [one for series in apart for one in series[1:] or series]
    longest = enough_lags(signals, n_inputs, longest)
    if not longest:
        return 1.0
    hold = _hold(signals, which)
    past = [_inputs(signals, i, range(longest, 0, -1)) for i in range(n_inputs)]
    past[which] = past[which][:, ::-hold]  # one sample of each hold, the latest first
    output, present = _outputs(signals, longest)
    target = np.concatenate([inputs[which, longest:] for inputs, _ in signals])
    tested = [output[:, :_ANSWERS]]
    if all(len(series) > 1 for series in apart):
        acts = _at_once([series[0] for series in apart], which, longest)
        tested = [np.column_stack([present - b * target, *tested]) for b in {0.0, acts}]
    may_change = np.concatenate([_on_clock(inputs[which], hold)[longest:] for inputs, _ in signals])
    fixed = np.column_stack([np.ones(target.size), *past])
    if may_change.sum() < FOR_EACH * (fixed.shape[1] + tested[0].shape[1]):
        return 1.0
    return max(
        _Scores.of(np.column_stack([fixed, one])[may_change], target[may_change], one.shape[1]).p_value()
        for one in tested
    )


def _at_once(signals: Signals, which: int, longest: int) -> float:
    """Return the coefficient of an input in the same sample; 0 if there are too few samples."""
    n_inputs = signals[0][0].shape[0]
    longest = enough_lags(signals, n_inputs, longest)
    return float(LongArx.of(signals, longest, shortest=[0] * n_inputs).b[which, 0]) if longest else 0.0


def _hold(signals: Signals, which: int) -> int:
    """Return the largest number of samples that divides all times for which an input is held."""
    changes = [np.flatnonzero(np.diff(inputs[which])) for inputs, _ in signals]
    return int(np.gcd.reduce(np.concatenate([[0], *map(np.diff, changes)]).astype(int))) or 1


def _on_clock(values: Array, hold: int) -> NDArray[np.bool_]:
    """Return samples at which an input held for multiples of `hold` samples may change, shape (n,)."""
    first = int(np.argmax(np.diff(values) != 0.0)) + 1
    return np.arange(values.size) % hold == first % hold


@dataclass(frozen=True, eq=False)
class _Scores:
    """Last columns of a regression, orthogonalised against the earlier ones, and their products with the target."""

    total: Array  # shape (n,): Products of the columns with the target
    products: Array  # shape (n_samples, n): Products of the columns with the residual, sample by sample
    variance: float
    freedom: int  # Number of samples minus unknowns

    @classmethod
    def of(cls, rows: Array, target: Array, n_last: int) -> _Scores:
        """Regress a target on rows, of which the last are tested."""
        q, _ = np.linalg.qr(rows)
        error = target - q @ (q.T @ target)
        freedom = target.size - rows.shape[1]
        last = q[:, -n_last:]
        variance = float(error @ error) / freedom + RESOLVED**2
        return cls(last.T @ target, last * error[:, None] * np.sqrt(target.size / freedom), variance, freedom)

    def p_value(self, part: slice = slice(None)) -> float:
        """Return the larger p-value of least squares and of Newey and West (Econometrica 55 (1987) 703-708)."""
        from scipy.special import fdtrc

        total, products = self.total[part], self.products[:, part]
        n, size = products.shape
        width = int(np.sqrt(n))
        spread = products.T @ products
        for lag in range(1, width):
            one = products[lag:].T @ products[:-lag]
            spread = spread + (1.0 - lag / width) * (one + one.T)
        plain = fdtrc(size, self.freedom, float(total @ total) / (size * self.variance))
        # Degrees of freedom that Bartlett's window leaves, for Hotelling's law with the covariance estimated by it.
        freedom = 1.5 * n / width - size + 1
        square = float(total @ np.linalg.solve(spread + 1e-12 * self.variance * np.eye(size), total))
        return float(max(plain, fdtrc(size, freedom, square * freedom / (size * (freedom + size - 1)))))


def enough_lags(signals: Signals, n_inputs: int, wanted: int) -> int:
    """Return the largest number of lags, up to `wanted`, for which there are enough samples; 0 if none."""
    for longest in range(wanted if n_inputs else 0, 0, -1):
        if n_residuals(signals, longest) >= FOR_EACH * (1 + min(_OUTPUT_LAGS, longest) + n_inputs * (longest + 1)):
            return longest
    return 0


def n_residuals(signals: Signals, longest: int) -> int:
    """Return the number of samples whose lags and next inputs are all measured."""
    return sum(max(0, output.size - longest) for _, output in signals)


def _order(columns: Array, fixed: int) -> int:
    """Return the number of output lags by Akaike's criterion, from the residuals in the triangular factor."""
    triangle = np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)
    last = triangle[:, -1] ** 2
    squares = np.cumsum(last[::-1])[::-1][fixed:-1]  # residuals' squares with 0, 1, ... lags of the output
    n = columns.shape[0]
    squares = np.maximum(squares, n * RESOLVED**2)
    return int(np.argmin(n * np.log(squares) + 2.0 * np.arange(squares.size)))


def _inputs(signals: Signals, which: int, lags: range) -> Array:
    """Return an input at some lags, shape (n, n_lags)."""
    first = max(lags)
    return np.concatenate(
        [np.column_stack([inputs[which, first - lag : inputs.shape[1] - lag] for lag in lags]) for inputs, _ in signals]
    )


def _outputs(signals: Signals, longest: int) -> tuple[Array, Array]:
    """Return the output at the lags 1 to 30 or `longest`, shape (n, n_lags), and the output, shape (n,)."""
    lags = range(1, min(_OUTPUT_LAGS, longest) + 1)
    past = [np.column_stack([y[longest - lag : y.size - lag] for lag in lags]) for _, y in signals]
    return np.concatenate(past), np.concatenate([y[longest:] for _, y in signals])
