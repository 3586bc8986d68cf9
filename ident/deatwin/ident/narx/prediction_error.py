"""Estimate process and noise terms together by the smallest sum of squared prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtbtrs

from deatwin.ident.narx.estimate import Estimate, least_squares
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable, derivative
from deatwin.plant.arrays import Array, Integers
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
    variance = point.square / (target.size - point.theta.size)
    tangent = _Tangent.of(point)
    root = np.linalg.pinv(tangent.common) / tangent.sizes[:, None]
    return NoiseFit(
        estimate=Estimate(theta=point.theta, theta_cov=variance * (root @ root.T), noise_variance=variance),
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
    """Parameters and start of e, (n_records, lead), with the prediction errors and their slopes by both."""

    theta: Array  # shape (n_terms,)
    start: Array  # shape (n_records, lead): e in the leading samples of each recording
    errors: Array  # shape (n_samples,), with the leading samples
    slopes: tuple[Array, ...]  # shape (n, lead + n_terms) of each recording: by its own start, by the parameters

    @property
    def square(self) -> float:
        return float(self.errors @ self.errors)


@dataclass(frozen=True, eq=False)
class _PredictionErrors:
    """Prediction errors as a function of the parameters and of the unknown errors before each recording."""

    process: Regression
    table: TermTable  # The noise terms
    rows: Array  # shape (n_terms, n_samples): Process terms, zero in the leading samples
    target: Array  # shape (n_samples,): Output, zero in the leading samples
    lead: int  # Number of leading samples of each recording

    @classmethod
    def of(cls, process: Regression, table: TermTable) -> _PredictionErrors:
        lead = _longest(table)
        rows, target = process.matrix()
        return cls(process, table, _led(process, lead, rows), _led(process, lead, target[None])[0], lead)

    @property
    def begins(self) -> Integers:
        """Positions of the recordings' first leading samples."""
        lengths = [record.n_samples - self.process.first + self.lead for record in self.process.recordings]
        return np.cumsum([0, *lengths[:-1]])

    @property
    def rest(self) -> Array:
        """A start of e at zero."""
        return np.zeros((len(self.process.recordings), self.lead))

    def spread(self, errors: Array) -> tuple[Array, ...]:
        """Return e by recordings, shape (n_outputs, n) each."""
        return spread(self.process, errors, self.lead)

    def whole(self, errors: Array) -> Array:
        """Return process and noise terms with given e, shape (n_terms, n_samples)."""
        noise = noise_rows(self.process, self.table, self.spread(errors))
        return np.vstack([self.rows, _led(self.process, self.lead, noise)])

    def at(self, theta: Array, start: Array, near: Array) -> _Point | None:
        """Solve the recursion of e from a guess; None if it diverges or does not forget its start."""
        errors, limit = near, _ROUNDING * float(np.linalg.norm(self.target))
        target = self.target.copy()
        target[np.add.outer(self.begins, np.arange(self.lead))] -= start
        for _ in range(_ROUNDS):
            with np.errstate(over="ignore", invalid="ignore"):
                terms = self.whole(errors)
                missed = target - theta @ terms - errors
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
        parts = np.split(terms, self.begins[1:], axis=1)
        slopes = tuple(
            _filtered([band], np.vstack([np.eye(self.lead, band.shape[1]), part])).T
            for band, part in zip(bands, parts, strict=True)
        )
        if not all(np.all(np.isfinite(slope)) for slope in slopes):
            return None
        return _Point(theta, start, errors, slopes)


def _starts(errors: _PredictionErrors) -> list[_Point]:
    """Return the least-squares fit without noise terms, and one with the resulting e."""
    plain = np.linalg.lstsq(errors.rows.T, errors.target)[0]
    left = errors.target - plain @ errors.rows
    theta = np.linalg.lstsq(errors.whole(left).T, errors.target)[0]
    parts = theta[: len(errors.rows)], theta[len(errors.rows) :]
    first = errors.at(np.concatenate([plain, np.zeros(len(parts[1]))]), errors.rest, left)
    smaller = (errors.at(np.concatenate([parts[0], parts[1] / 2**n]), errors.rest, left) for n in range(_HALVINGS))
    second = next((point for point in smaller if point is not None), None)
    return [point for point in (first, second) if point is not None]


def _minimise(
    errors: _PredictionErrors, point: _Point, tolerance: float, max_iterations: int
) -> tuple[_Point, list[float], bool]:
    """Search from a point by damped Gauss-Newton steps."""
    changes: list[float] = []
    damping, tangent = 0.0, None
    for _ in range(max_iterations + 1):
        if tangent is None:
            tangent = _Tangent.of(point)
            size = float(np.sqrt(point.square))
            changes.append(tangent.explained / max(size, np.finfo(float).tiny))
            if changes[-1] <= tolerance or size <= _ROUNDING * float(np.linalg.norm(errors.target)):
                return point, changes, True
        step, start = tangent.step(damping)
        further = errors.at(point.theta + step, point.start + start, point.errors)
        if further is not None and further.square <= point.square * (1.0 + _SQUARE_ROUNDING):
            point, tangent = further, None
            damping = damping / 10.0 if damping > 1e-6 else 0.0
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > _MOST_DAMPED:
                break
    return point, changes, False


@dataclass(frozen=True, eq=False)
class _Tangent:
    """Least squares of the errors along their slopes, as triangles: starts are eliminated recording by recording."""

    own_sizes: Array  # shape (n_records, lead): Norms of the slopes by the start
    sizes: Array  # shape (n_terms,): Norms of the slopes by the parameters
    own: Array  # shape (n_records, lead, lead + n_terms + 1): Rows of the start, and the errors along them
    common: Array  # shape (n_terms, n_terms): Triangle of what is left, by the parameters
    along: Array  # shape (n_terms,): The errors along it

    @classmethod
    def of(cls, point: _Point) -> _Tangent:
        lead = point.start.shape[1]
        own_sizes = np.array([_norms(slope[:, :lead]) for slope in point.slopes])
        sizes = _norms(np.array([np.linalg.norm(slope[:, lead:], axis=0) for slope in point.slopes]))
        rows, begin = [], 0
        for slope, own_size in zip(point.slopes, own_sizes, strict=True):
            q, r = np.linalg.qr(slope / np.concatenate([own_size, sizes]))
            rows.append(np.column_stack([r, q.T @ point.errors[begin : begin + len(slope)]]))
            begin += len(slope)
        own = np.array([each[:lead] for each in rows])
        q, common = np.linalg.qr(np.concatenate([each[lead:, lead:-1] for each in rows]))
        return cls(own_sizes, sizes, own, common, q.T @ np.concatenate([each[lead:, -1] for each in rows]))

    @property
    def explained(self) -> float:
        """Norm of the errors along all slopes."""
        return float(np.sqrt(np.sum(self.own[..., -1] ** 2) + self.along @ self.along))

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the damped step of the parameters and of the start of e."""
        lead = self.own.shape[1]
        weights = np.sqrt(damping) * np.eye(lead, self.own.shape[2])
        damped = np.concatenate([self.own, np.broadcast_to(weights, self.own.shape)], axis=1)
        r: Array = np.linalg.qr(damped)[1]
        left = r[:, lead:, lead:].reshape(-1, self.sizes.size + 1)
        matrix = np.vstack([self.common, np.sqrt(damping) * np.eye(self.sizes.size), left[:, :-1]])
        step = np.linalg.lstsq(matrix, np.concatenate([self.along, np.zeros(self.sizes.size), left[:, -1]]))[0]
        wanted = r[:, :lead, -1] - r[:, :lead, lead:-1] @ step
        own = (np.linalg.pinv(r[:, :lead, :lead]) @ wanted[..., None])[..., 0]
        return step / self.sizes, own / self.own_sizes


def _norms(rows: Array) -> Array:
    """Return the norms of columns, 1 for zero."""
    norms = np.linalg.norm(rows, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


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
