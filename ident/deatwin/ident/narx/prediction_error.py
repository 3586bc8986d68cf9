"""Estimate process and noise terms together by the smallest sum of squared prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtbtrs

from deatwin.ident.narx.estimate import Estimate, least_squares
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable, derivative
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_ROUNDS = 12  # Newton's steps for nonlinear recursions of the errors; one that needs more is about to diverge
_ROUNDING = 1e-13  # accuracy of the errors, as a share of the output: a few hundred units in the last place
_SQUARE_ROUNDING = 1e-14  # relative accuracy of a sum of squares: a smaller change is neither better nor worse
_MOST_DAMPED = 1e10  # damping beyond which a step is shorter than rounding
_HALVINGS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit:
    """Estimates of process and noise terms together."""

    estimate: Estimate
    noise: tuple[Array, ...]
    changes: tuple[float, ...]
    converged: bool  # False if e did not settle: the estimates are the best that were found


def prediction_error_fit(
    process: Regression, noise_terms: Sequence[Term], *, tolerance: float = 1e-6, max_iterations: int = 100
) -> NoiseFit:
    """Estimate process and noise terms by least squared prediction errors (Ljung 1999, 9.3 and 10.2)."""
    rows, target = process.matrix()
    if target.size <= len(rows) + len(noise_terms):
        raise ModelError(
            f"{target.size} samples do not determine {len(rows) + len(noise_terms)} parameters and the noise"
        )
    if not noise_terms:
        plain = least_squares(rows, target)
        noise = spread(process, target - plain.theta @ rows)
        return NoiseFit(estimate=plain, noise=noise, changes=(), converged=True)
    errors = _PredictionErrors.of(process, TermTable(tuple(noise_terms)))
    ends = [_minimise(errors, start, tolerance, max_iterations) for start in _starts(errors)]
    point, changes, converged = min(ends, key=lambda end: end[0].square)
    wanted = np.r_[: len(rows), len(errors.rows) : point.theta.size]
    variance = point.square / (target.size - wanted.size)
    norms, _, r = _triangle(point.slopes)
    root = (np.linalg.pinv(r) / norms[:, None])[wanted]
    return NoiseFit(
        estimate=Estimate(theta=point.theta[wanted], theta_cov=variance * (root @ root.T), noise_variance=variance),
        noise=errors.spread(point.errors),
        changes=tuple(changes),
        converged=converged,
    )


def noise_rows(data: Regression, table: TermTable, noise: Sequence[Array]) -> Array:
    """Evaluate noise terms over all fitted samples. Shapes: `noise` (n_outputs, n); returns (n_terms, n_samples)."""
    return np.concatenate(
        [
            data.for_scaled(table).rows(*data.scaled(record), data.first, record.n_samples, e)
            for record, e in zip(data.recordings, noise, strict=True)
        ],
        axis=1,
    )


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters with their prediction errors, shape (n_samples,), and slopes, shape (n_terms, n_samples)."""

    theta: Array
    errors: Array
    slopes: Array

    @property
    def square(self) -> float:
        return float(self.errors @ self.errors)


@dataclass(frozen=True, eq=False)
class _PredictionErrors:
    """Prediction errors as a function of the parameters and of the unknown errors before each recording."""

    process: Regression
    table: TermTable  # The noise terms
    rows: Array  # shape (n_terms + n_starts, n_samples): Process terms, then one row for each sample of the start
    target: Array  # shape (n_samples,): Output

    @classmethod
    def of(cls, process: Regression, table: TermTable) -> _PredictionErrors:
        lead = _longest(table)
        rows, target = process.matrix()
        rows, target = _led(process, lead, rows), _led(process, lead, target[None])[0]
        starts = np.flatnonzero(_led(process, lead, np.ones((1, process.n_samples)))[0] == 0.0)
        pulses = np.zeros((starts.size, target.size))
        pulses[np.arange(starts.size), starts] = 1.0
        return cls(process, table, np.vstack([rows, pulses]), target)

    def spread(self, errors: Array) -> tuple[Array, ...]:
        """Return e by recordings, shape (n_outputs, n) each."""
        return spread(self.process, errors, _longest(self.table))

    def whole(self, errors: Array) -> Array:
        """Return process and noise terms with given e, shape (n_terms, n_samples)."""
        noise = noise_rows(self.process, self.table, self.spread(errors))
        return np.vstack([self.rows, _led(self.process, _longest(self.table), noise)])

    def at(self, theta: Array, near: Array) -> _Point | None:
        """Solve the recursion of e from a guess; None if it diverges or does not forget its start."""
        errors, limit = near, _ROUNDING * float(np.linalg.norm(self.target))
        for _ in range(_ROUNDS):
            with np.errstate(over="ignore", invalid="ignore"):
                terms = self.whole(errors)
                missed = self.target - theta @ terms - errors
                bands = _bands(self.process, self.table, theta[len(self.rows) :], self.spread(errors))
                if float(np.linalg.norm(missed)) <= limit:
                    break
                errors = errors + _filtered(bands, missed[None])[0]
                if not np.isfinite(errors @ errors):
                    return None
        else:
            return None
        if not all(map(_forgets, bands)):
            return None
        slopes = _filtered(bands, terms)
        return _Point(theta, errors, slopes) if np.all(np.isfinite(slopes)) else None


def _starts(errors: _PredictionErrors) -> list[_Point]:
    """Return the least-squares fit without noise terms, and one with the resulting e."""
    plain = np.linalg.lstsq(errors.rows.T, errors.target)[0]
    left = errors.target - plain @ errors.rows
    theta = np.linalg.lstsq(errors.whole(left).T, errors.target)[0]
    parts = theta[: len(errors.rows)], theta[len(errors.rows) :]
    first = errors.at(np.concatenate([plain, np.zeros(len(parts[1]))]), left)
    smaller = (errors.at(np.concatenate([parts[0], parts[1] / 2**n]), left) for n in range(_HALVINGS))
    second = next((point for point in smaller if point is not None), None)
    return [point for point in (first, second) if point is not None]


def _minimise(
    errors: _PredictionErrors, point: _Point, tolerance: float, max_iterations: int
) -> tuple[_Point, list[float], bool]:
    """Search from a point by damped Gauss-Newton steps."""
    changes: list[float] = []
    damping, step = 0.0, None
    for _ in range(max_iterations + 1):
        if step is None:
            norms, q, r = _triangle(point.slopes)
            along = q.T @ point.errors
            size = float(np.sqrt(point.square))
            changes.append(float(np.linalg.norm(along)) / max(size, np.finfo(float).tiny))
            if changes[-1] <= tolerance or size <= _ROUNDING * float(np.linalg.norm(errors.target)):
                return point, changes, True
        damped = np.vstack([r, np.sqrt(damping) * np.eye(len(r))])
        step = np.linalg.lstsq(damped, np.concatenate([along, np.zeros(len(r))]))[0] / norms
        further = errors.at(point.theta + step, point.errors)
        if further is not None and further.square <= point.square * (1.0 + _SQUARE_ROUNDING):
            point, step = further, None
            damping = damping / 10.0 if damping > 1e-6 else 0.0
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > _MOST_DAMPED:
                break
    return point, changes, False


def _triangle(slopes: Array) -> tuple[Array, Array, Array]:
    """Return norms of rows, shape (n_terms,), and Q and R of the rows divided by them."""
    norms = np.linalg.norm(slopes, axis=1)
    norms[norms == 0.0] = 1.0
    q, r = np.linalg.qr((slopes / norms[:, None]).T)
    return norms, q, r


def _longest(table: TermTable) -> int:
    return max(v.lag for v in table.variables if v.kind == "e")


def _led(data: Regression, lead: int, rows: Array) -> Array:
    """Return rows over all fitted samples with some zeros before each recording."""
    begins = np.cumsum([0, *(record.n_samples - data.first for record in data.recordings)])[:-1]
    return np.insert(rows, np.repeat(begins, lead), 0.0, axis=1)


def spread(data: Regression, errors: Array, lead: int = 0) -> tuple[Array, ...]:
    """Return e of all samples and of `lead` before them, (n_outputs, n) per recording, zero where it was not fitted."""
    noise, begin = [], 0
    for record in data.recordings:
        end = begin + record.n_samples - data.first + lead
        one = np.zeros(record.outputs.shape)
        one[data.output, data.first - lead :] = errors[begin:end]
        noise.append(one)
        begin = end
    return tuple(noise)


def _bands(data: Regression, table: TermTable, theta: Array, noise: Sequence[Array]) -> list[Array]:
    """Return the slopes of the recursion of e in each recording, c_l(k) at [l, k-l] with the leading samples."""
    lags = sorted({v for v in table.variables if v.kind == "e"})
    bands, lead = [], lags[-1].lag
    for record, e in zip(data.recordings, noise, strict=True):
        band = np.zeros((lead + 1, record.n_samples - data.first + lead))
        band[0] = 1.0
        for variable in lags:
            parts, weights = derivative(table.terms, theta, variable)
            along = weights @ data.for_scaled(parts).rows(*data.scaled(record), data.first, record.n_samples, e)
            band[variable.lag, lead - variable.lag : band.shape[1] - variable.lag] = along
        bands.append(band)
    return bands


def _filtered(bands: Sequence[Array], rows: Array) -> Array:
    """Return f(k) = r(k) - sum_l c_l(k) f(k-l) of rows, recording by recording; returns the shape of `rows`."""
    found, begin = np.empty_like(rows), 0
    for band in bands:
        end = begin + band.shape[1]
        solved, _ = dtbtrs(band, rows[:, begin:end].T, uplo="L", diag="U")
        found[:, begin:end] = solved.T
        begin = end
    return found


def _forgets(band: Array) -> bool:
    """Return whether e forgets its start: a disturbance of e decays if the recording is repeated for ever."""
    lag, n = band.shape[0] - 1, band.shape[1]
    if n <= 2 * lag:
        return True
    passed_on = np.zeros((lag, n - lag))  # response to unit disturbances in the leading samples
    for start in range(lag):
        for k in range(lag, lag + start + 1):
            passed_on[start, k - lag] = -band[k - start, start]
    with np.errstate(over="ignore", invalid="ignore"):
        end = _filtered([np.ascontiguousarray(band[:, lag:])], passed_on)[:, -lag:]
    return bool(np.all(np.isfinite(end)) and np.abs(np.linalg.eigvals(end)).max() < 1.0)
