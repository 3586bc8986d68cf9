"""Minimise the free-run error of a nonlinear state space (Levenberg-Marquardt, exact sensitivities), or its first errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.nss.march import System
from deatwin.plant.arrays import Array

DIVERGED = 30.0  # Standard deviations of an output beyond which a run is given up: no trained output is that large
_NULL = 1e-9  # Share of the largest singular value below which a direction only changes the coordinates of the state
_TRIES = 16  # Most dampings, each four times the last, before a step is given up: they span nine decades


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """A scaled recording: the first samples are fitted, the others held out."""

    inputs: Array  # shape (n_inputs, n)
    outputs: Array  # shape (n_outputs, n)
    fitted: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """Weights with the initial state of each record, and their squared errors."""

    system: System
    starts: Array  # shape (n_records, n_states)
    cost: float
    held_out: float

    @property
    def theta(self) -> Array:
        """Free weights and first states."""
        return np.concatenate([self.system.theta, self.starts.ravel()])


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Result of a search."""

    point: Point
    steps: int  # Number of steps that led to the point
    overfitted: bool = False  # True if the held-out error stopped falling while the training error fell
    interrupted: bool = False


def judged(system: System, starts: Array, records: Sequence[Record]) -> Point:
    """Run over all records and sum the squared errors; infinite if a run diverges."""
    cost = held = 0.0
    for record, start in zip(records, starts, strict=True):
        outputs, _, reached = system.run(record.inputs, start, limit=DIVERGED)
        if reached < record.fitted:
            return Point(system=system, starts=starts, cost=np.inf, held_out=np.inf)
        squares = ((outputs - record.outputs.T) ** 2).sum(axis=1)
        cost += float(squares[: record.fitted].sum())
        held = held + float(squares[record.fitted :].sum()) if reached == squares.size else np.inf
    return Point(system=system, starts=starts, cost=cost, held_out=held)


def triangle(point: Point, records: Sequence[Record]) -> Array:
    """Return R, (n + 1, n + 1), of the QR decomposition of (sensitivities, errors) over the fitted samples."""
    found = np.zeros((0, point.theta.size + 1))
    for rows in _rows(point, records):
        found = np.asarray(np.linalg.qr(np.concatenate([found, rows.reshape(-1, rows.shape[-1])]), mode="r"))
    return found


def _rows(point: Point, records: Sequence[Record]) -> Iterator[Array]:
    """Yield (sensitivities, errors) of each record, shape (n, n_outputs, n_theta + n_records n_states + 1)."""
    n = point.system.theta.size
    for i, (record, start) in enumerate(zip(records, point.starts, strict=True)):
        outputs, gradient = point.system.sensitivities(record.inputs[:, : record.fitted], start)
        rows = np.zeros((*outputs.shape, point.theta.size + 1))
        rows[..., :n] = gradient[..., :n]
        rows[..., n + i * start.size : n + (i + 1) * start.size] = gradient[..., n:]
        rows[..., -1] = record.outputs[:, : record.fitted].T - outputs
        yield rows


def moved(point: Point, step: Array, records: Sequence[Record]) -> Point:
    """Return the point after a step of the weights and initial states."""
    theta = point.theta + step
    n = theta.size - point.starts.size
    return judged(point.system.with_theta(theta[:n]), theta[n:].reshape(point.starts.shape), records)


def search(
    system: System,
    starts: Array,
    records: Sequence[Record],
    *,
    steps: int,
    tolerance: float = 1e-5,
    patience: int = 10,
    progress: Callable[[int, Point], None] | None = None,
) -> Found:
    """Reduce the free run's squared error by damped steps (Levenberg, Marquardt) in directions that move an output, until
    it falls by less than `tolerance` of itself twice in a row, or `patience` steps bring no lower held-out error."""
    point = best = judged(system, starts, records)
    holds_out = any(record.fitted < record.outputs.shape[1] for record in records)
    damping, small, best_at, size = 1e-2, 0, 0, np.zeros(point.theta.size)

    def end(count: int, *, overfitted: bool = False, interrupted: bool = False) -> Found:
        kept, after = (best, best_at) if holds_out else (point, count)
        return Found(point=kept, steps=after, overfitted=overfitted, interrupted=interrupted)

    for count in range(1, steps + 1):
        try:
            rows = triangle(point, records)
            size = np.maximum(size, np.linalg.norm(rows[:, :-1], axis=0))
            scale, left, values, right, seen = _directions(rows[:, :-1], size)
            along = (left.T @ rows[:, -1])[seen]
            for _ in range(_TRIES):
                weights = values[seen] / (values[seen] ** 2 + damping**2 * values[0] ** 2) * along
                ahead = moved(point, (weights @ right[seen]) / scale, records)
                if ahead.cost < point.cost:
                    break
                damping *= 4.0
            else:
                return end(count)
            damping = max(damping / 4.0, 1e-8)
            small = small + 1 if point.cost - ahead.cost <= tolerance * point.cost else 0
            point = ahead
            if point.held_out < best.held_out:
                best, best_at = point, count
            if progress is not None:
                progress(count, point)
        except KeyboardInterrupt:
            return end(count, interrupted=True)
        if small == 2 or point.cost == 0.0:
            break
        if holds_out and count - best_at >= patience:
            return end(count, overfitted=True)
    return end(count)


def _directions(rows: Array, size: Array) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """Return scales, the singular value decomposition of scaled rows (n, m), and which directions change an output."""
    scale = np.where(size > 0.0, size, 1.0)
    left, values, right = np.linalg.svd(rows / scale, full_matrices=False)
    return scale, left, values, right, values > _NULL * values[0]


def covariance(point: Point, rows: Array, records: Sequence[Record]) -> tuple[Array, Array]:
    """Return the weights' covariance, zero along the states' coordinates, and noise variances, by the `triangle`."""
    rows = rows[:, :-1]
    scale, _, values, right, seen = _directions(rows, np.linalg.norm(rows, axis=0))
    rank, samples = int(seen.sum()), sum(record.fitted for record in records)
    p = len(point.system.output)
    inverse = right[seen] / scale / values[seen, None]
    squares, information = np.zeros(p), np.zeros((p, rank, rank))
    for found in _rows(point, records):
        squares += (found[..., -1] ** 2).sum(axis=0)
        along = np.moveaxis(found[..., :-1] @ inverse.T, 1, 0)
        information += along.swapaxes(1, 2) @ along
    noise = squares / max(samples - rank / p, 1.0)
    # The fit weighs all outputs alike, so each adds its own noise (White); the information of one is a unit matrix.
    sizes, axes = np.linalg.eigh(np.tensordot(noise, information, axes=1))
    roots = np.sqrt(np.maximum(sizes, 0.0))[:, None] * (axes.T @ inverse[:, : point.system.theta.size])
    # Deviations whose squares underflow, as those of an exact fit, are set to zero.
    roots[:, np.linalg.norm(roots, axis=0) < np.sqrt(np.finfo(float).tiny / np.finfo(float).eps)] = 0.0
    return roots.T @ roots, noise


def all_fitted(records: Sequence[Record]) -> list[Record]:
    """Return the records with all samples fitted."""
    return [replace(record, fitted=record.outputs.shape[1]) for record in records]


_STEPS = 50  # Most Gauss-Newton steps; few samples need few
_WIDTH = 3.0  # Prior deviation of a first state: its rms value is about one in training, and a record may begin outside
_EXACT = 1e-6  # Noise, in scaled outputs, below which readings are exact, so that rounding competes with no prior


@dataclass(frozen=True, kw_only=True, eq=False)
class Opening:
    """Initial state with its covariance for known weights, and its derivative by these."""

    state: Array  # shape (n_states,)
    covariance: Array  # shape (n_states, n_states)
    by_theta: Array  # shape (n_states, n_theta)

    @classmethod
    def known(cls, state: Array, n_theta: int) -> Opening:
        """Return a state that is exact."""
        return cls(state=state, covariance=np.zeros((state.size, state.size)), by_theta=np.zeros((state.size, n_theta)))


def opened(system: System, inputs: Array, outputs: Array, noise: Array) -> Opening:
    """Fit the first state. Shapes: `inputs` (n_inputs, n); `outputs` (n_outputs, n); `noise` (n_outputs,) deviations."""
    n, sigma = system.basis.states, np.maximum(noise, _EXACT)
    state = np.zeros(n)

    def errors(at: Array) -> Array:
        found, _, reached = system.run(inputs, at)
        if reached < inputs.shape[1] or not np.all(np.isfinite(found)):
            return np.full(outputs.size + n, np.inf)
        return np.concatenate([((outputs.T - found) / sigma).ravel(), -at / _WIDTH])

    def slopes(at: Array) -> Array:
        gradient = system.sensitivities(inputs, at)[1]
        return np.asarray((gradient / sigma[:, None]).reshape(outputs.size, -1))

    left, count = errors(state), system.theta.size
    for _ in range(_STEPS):
        if not np.all(np.isfinite(left)):
            break
        rows = np.concatenate([slopes(state)[:, count:], np.eye(n) / _WIDTH])
        step = np.linalg.lstsq(rows, left, rcond=None)[0]
        for _ in range(30):
            ahead = errors(state + step)
            if ahead @ ahead < left @ left:
                break
            step = step / 2.0
        else:
            break
        fall = left @ left - ahead @ ahead
        state, left = state + step, ahead
        if fall <= 1e-12 * (left @ left):
            break
    if not np.all(np.isfinite(left)):
        return Opening.known(state, count)
    found = slopes(state)
    information = found[:, count:].T @ found[:, count:] + np.eye(n) / _WIDTH**2
    inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return Opening(state=state, covariance=inverse, by_theta=-inverse @ found[:, count:].T @ found[:, :count])
