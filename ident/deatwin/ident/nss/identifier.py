"""Common base of estimators of nonlinear state spaces: scales, linear start, search and model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import real_number, whole_number
from deatwin.ident.look.best_linear import best_linear_approximation
from deatwin.ident.narx.drive import signals_like
from deatwin.ident.narx.estimate import converged
from deatwin.ident.narx.identifier import FitStatus, Identifier, Progress, silent
from deatwin.ident.narx.regression import Recordings, flatten, provenance_of, require_alike, require_no_target
from deatwin.ident.nss.basis import Basis
from deatwin.ident.nss.document import weights_of
from deatwin.ident.nss.march import System
from deatwin.ident.nss.model import NonlinearStateSpace
from deatwin.ident.nss.search import Found, Point, Record, all_fitted, covariance, judged, search, triangle
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

_LINEAR_STEPS = 25  # Steps of the linear start, which need not converge to the last digit
_PATIENCE = 20  # Steps without a lower held-out error after which a search ends: it may rise before a better valley


class StateSpaceIdentifier(Identifier):
    """Base class of the estimators of nonlinear state spaces.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. ``theta_cov`` is valid if the noise is white and on the readings.
    status_ : FitStatus
        Outcome. ``DONE``: the gradient of the error over all samples is small. ``INTERRUPTED``: the fit was ended by
        Ctrl-C. ``HELD_OUT``: the held-out error stopped falling, so the fit deliberately ended before the minimum.
        ``NOT_CONVERGED``: the fit reached its largest number of steps, or no further step lowered the error.
    linear_error_ : ndarray, shape (n_outputs,)
        Rms free-run error of the initial linear model over all samples, in the outputs' units.
    error_ : ndarray, shape (n_outputs,)
        Rms free-run error of ``model_`` over all samples, in the outputs' units.
    held_out_error_ : ndarray, shape (n_outputs,)
        Rms free-run error on the held-out samples, in the outputs' units, before the model is refitted to all samples;
        NaN if no samples are held out.
    first_states_ : ndarray, shape (n_recordings, n_states)
        State of the model at the first sample of each recording: the argument ``initial`` of
        `NonlinearStateSpace.simulate`.
    """

    model_: NonlinearStateSpace
    first_states_: Array
    status_: FitStatus
    states: int
    feedthrough: bool
    held_out: float
    max_steps: int

    @abstractmethod
    def _begun(self, linear: Point, records: Sequence[Record]) -> list[Point]:
        """Return the starting points of the search."""

    @abstractmethod
    def _needed(self, record: Recording) -> int:
        """Return the number of free weights, without those that only change the states' coordinates."""

    @abstractmethod
    def _require(self) -> None:
        """Raise ModelError unless the arguments make sense."""

    def fit(self, recordings: Recordings, y: None = None, *, progress: Progress | None = None) -> Self:
        """Estimate the weights from `recordings`; `y` must be None, and `progress` takes a share and a description."""
        from threadpoolctl import threadpool_limits

        require_no_target(y)
        chosen = flatten(recordings)
        require_alike(chosen)
        self._require()
        told = progress or silent
        with threadpool_limits(1):  # tall and narrow matrices, for which more threads only wait for each other
            sides, records = _scaled(chosen, self.held_out, self._needed(chosen[0]))
            told(0.0, "a linear state space")
            found = linear_start(
                records, self.states, lines=_lines(chosen, sides), steps=_LINEAR_STEPS, feedthrough=self.feedthrough
            )
            whole = all_fitted(records)
            self.linear_error_ = _errors(found.point, whole)[0] * sides["output"][1]
            start = found.point
            if not found.interrupted:
                points = self._begun(in_own_coordinates(found.point, records), records)
                start, found = self._searched(points, records, told)
            self.held_out_error_ = _errors(found.point, records)[1] * sides["output"][1]
            overfitted = found.overfitted
            if not found.interrupted:
                found = _on_all(found, start, whole, self.max_steps)
            point, rows = found.point, triangle(found.point, whole)
            self.error_ = _errors(point, whole)[0] * sides["output"][1]
            self.first_states_ = point.starts
            self.model_ = _model(self, point, rows, whole, chosen, sides)
        self.status_ = _status(found, overfitted, rows, whole)
        if not found.interrupted:  # a caller's progress may raise the interrupt again
            told(1.0, "done")
        return self

    def _require_whole(self, *names: str) -> None:
        for name in (*names, "max_steps"):
            whole_number(getattr(self, name), name)
        if not 0.0 <= real_number(self.held_out, "held_out") < 1.0:
            raise ModelError(f"held_out = {self.held_out}; it must be at least 0 and below 1")

    def _searched(self, starts: Sequence[Point], records: Sequence[Record], told: Progress) -> tuple[Point, Found]:
        """Fit all weights from each start; return the best result and its start."""
        found: list[Found] = []
        for number, start in enumerate(starts):

            def say(count: int, point: Point, number: int = number) -> None:
                share = (number + count / self.max_steps) / len(starts)
                told(share, f"step {count} of search {number + 1} of {len(starts)}")

            found.append(
                search(start.system, start.starts, records, steps=self.max_steps, patience=_PATIENCE, progress=say)
            )
            if found[-1].interrupted:
                break
        ends = [one.point.held_out if self.held_out else one.point.cost for one in found]
        best = int(np.argmin(ends))
        return starts[best], replace(found[best], interrupted=found[-1].interrupted)


Sides = dict[str, tuple[Array, Array]]


def _scaled(recordings: Sequence[Recording], held_out: float, needed: int) -> tuple[Sides, list[Record]]:
    """Return origins and scales of inputs and outputs, and the scaled records; ModelError if they are unsuitable."""
    sides = {}
    for side in ("input", "output"):
        rows = np.concatenate([getattr(record, f"{side}s") for record in recordings], axis=1)
        if len(rows) == 0:
            raise ModelError(f"the recordings have no {side}s; a nonlinear state space needs one")
        sides[side] = (rows.mean(axis=1), rows.std(axis=1))
        if flat := [
            name for name, size in zip(getattr(recordings[0], f"{side}_names"), sides[side][1], strict=True) if not size
        ]:
            raise ModelError(f'the {side} "{flat[0]}" is constant: nothing can be learned from it')
    records = []
    for record in recordings:
        inputs, outputs = (
            (signals - sides[side][0][:, None]) / sides[side][1][:, None]
            for side, signals in (("input", record.inputs), ("output", record.outputs))
        )
        fitted = max(round(record.n_samples * (1.0 - held_out)), 1)
        records.append(Record(inputs=inputs, outputs=outputs, fitted=fitted))
    told = sum(record.fitted for record in records) * len(records[0].outputs)
    if told <= needed:
        raise ModelError(
            f"{told} fitted readings for {needed} weights: give longer recordings, fewer states or terms, or less held out"
        )
    return sides, records


def _lines(recordings: Sequence[Recording], sides: Sides) -> Lines | None:
    """Return the best linear approximation in scaled signals; None if the recordings do not allow one."""
    first = recordings[0]
    if len(first.inputs) > 1 or len(first.outputs) > 1:
        return None
    try:
        found = best_linear_approximation(recordings)
    except DataError:
        return None
    by = float(sides["input"][1][0] / sides["output"][1][0])
    deviations = by * np.sqrt(found.variance)
    sound = deviations > 0.0
    angles = 2.0 * np.pi * found.frequencies * first.sample_time
    return by * found.response[sound, None, None], angles[sound], deviations[sound]


def _on_all(found: Found, start: Point, whole: Sequence[Record], max_steps: int) -> Found:
    """Fit all samples: to convergence, or from the start for as many steps as the held-out samples allowed."""
    if not found.overfitted:
        return search(found.point.system, found.point.starts, whole, steps=max_steps)
    again = search(start.system, start.starts, whole, steps=found.steps) if found.steps else found
    # Only if the other samples do not lead the search astray; otherwise the held-out samples found a better end.
    better = again.point.cost < judged(found.point.system, found.point.starts, whole).cost
    return again if better else replace(found, interrupted=again.interrupted)


def _status(found: Found, overfitted: bool, rows: Array, whole: Sequence[Record]) -> FitStatus:
    """Return the status of a search over all samples; `rows` is the `triangle` at its end."""
    if found.interrupted:
        return FitStatus.INTERRUPTED
    readings = np.concatenate([record.outputs.ravel() for record in whole])
    if converged(rows[:, :-1], rows[:, -1], readings.size, float(np.linalg.norm(readings))):
        return FitStatus.DONE
    return FitStatus.HELD_OUT if overfitted else FitStatus.NOT_CONVERGED


def _errors(point: Point, records: Sequence[Record]) -> tuple[Array, Array]:
    """Return the rms error of each output on the fitted and on the held-out samples, in scaled outputs."""
    parts: tuple[list[Array], list[Array]] = ([], [])
    for record, start in zip(records, point.starts, strict=True):
        left = (record.outputs.T - point.system.run(record.inputs, start)[0]) ** 2
        left[np.isnan(left)] = np.inf  # NaN after the end of a diverged run
        parts[0].append(left[: record.fitted])
        parts[1].append(left[record.fitted :])
    fitted, rest = (np.concatenate(part) for part in parts)
    return np.sqrt(fitted.mean(axis=0)), np.sqrt(rest.mean(axis=0)) if len(rest) else np.full(rest.shape[1], np.nan)


def _model(
    identifier: Identifier,
    point: Point,
    rows: Array,
    records: Sequence[Record],
    recordings: Sequence[Recording],
    sides: Sides,
) -> NonlinearStateSpace:
    """Return the model with its covariance; `rows` is the `triangle` at the point."""
    cov, noise = covariance(point, rows, records)
    system = point.system
    return NonlinearStateSpace(
        terms=system.basis.written,
        **weights_of(system),
        theta_cov=cov,
        noise_variance=noise * sides["output"][1] ** 2,
        **signals_like(recordings[0]),
        input_origin=sides["input"][0],
        input_scale=sides["input"][1],
        output_origin=sides["output"][0],
        output_scale=sides["output"][1],
        provenance=provenance_of(identifier, recordings, sum(record.n_samples for record in recordings)),
    )


_MIRROR = 0.999  # Largest magnitude of a pole: an integrator with noise then stays bounded over a thousand samples


def from_lines(response: Complex, angles: Array, deviations: Array, n_states: int, rows: int) -> tuple[Array, Array]:
    """Return A and C from `response` (n_lines, n_outputs, n_inputs) at `angles` (n_lines,), rad a sample (McKelvey, Akcay,
    Ljung, IEEE Trans. Autom. Control 41 (1996) 960-979), weighted by `deviations` (Pintelon, Automatica 38 (2002) 1295)."""
    n_lines, p, m = response.shape
    turns = np.exp(1j * np.outer(np.arange(rows), angles))

    def stacked(blocks: Complex) -> Array:
        """Turn blocks (n_lines, a, b) by all powers of z; returns (rows a, 2 n_lines b), real."""
        turned = np.einsum("rk,kab->rakb", turns, blocks).reshape(rows * blocks.shape[1], n_lines * blocks.shape[2])
        return np.concatenate([turned.real, turned.imag], axis=1)

    both = np.concatenate(
        [stacked(np.asarray(np.ones((n_lines, 1, 1)) * np.eye(m), dtype=np.complex128)), stacked(response)]
    )
    lower = _lower(both)[rows * m :, rows * m :]
    noise = stacked(np.asarray(deviations[:, None, None] * np.eye(p), dtype=np.complex128))
    root = _lower(noise)
    return _observed(root @ np.linalg.svd(np.linalg.solve(root, lower))[0][:, :n_states], p)


def from_samples(records: Sequence[tuple[Array, Array]], n_states: int, rows: int) -> tuple[Array, Array]:
    """Return A and C from inputs (n_inputs, n) and outputs (n_outputs, n), n > 2 `rows`, by the past of both as
    instruments (Verhaegen, Automatica 30 (1994) 61-74, doi:10.1016/0005-1098(94)90229-1)."""
    inputs, outputs = (_hankel([record[i] for record in records], 2 * rows) for i in (0, 1))
    m, p = records[0][0].shape[0], records[0][1].shape[0]
    stack = np.concatenate([inputs[rows * m :], inputs[: rows * m], outputs])
    lower = _lower(stack)
    future, past = rows * (2 * m + p), rows * m
    return _observed(np.linalg.svd(lower[future:, past:future])[0][:, :n_states], p)


def _lower(rows: Array) -> Array:
    """Return L of the LQ decomposition of rows (n, m), shape (n, n)."""
    return np.asarray(np.linalg.qr(rows.T, mode="r"), dtype=np.float64).T


def _hankel(signals: Sequence[Array], rows: int) -> Array:
    """Return the block Hankel matrices of signals (n_channels, n), side by side."""
    parts = []
    for signal in signals:
        count = signal.shape[1] - rows + 1
        parts.append(np.concatenate([signal[:, i : i + count] for i in range(rows)]))
    return np.concatenate(parts, axis=1)


def _observed(observability: Array, p: int) -> tuple[Array, Array]:
    """Return A and C from an extended observability matrix; poles on or outside the unit circle are reflected."""
    a = np.asarray(np.linalg.lstsq(observability[:-p], observability[p:], rcond=None)[0], dtype=np.float64)
    return stabilised(a), observability[:p]


def stabilised(a: Array) -> Array:
    """Return A with all poles inside the unit circle; those outside are reflected."""
    poles, vectors = np.linalg.eig(a)
    size = np.abs(poles)
    inside = np.where(size > 1.0, poles / size**2, poles)
    inside = inside * np.minimum(1.0, _MIRROR / np.maximum(np.abs(inside), 1e-300))
    return a if np.allclose(inside, poles, rtol=0.0, atol=0.0) else np.real(vectors * inside @ np.linalg.inv(vectors))


Lines = tuple[NDArray[np.complex128], Array, Array]

_ROWS = (1.5, 3.0, 6.0)
"""Block rows per state: few suit fast poles, many slow ones; those with the smallest free-run error are kept."""
_LONGEST = 20_000  # Samples of a record that the subspace method uses; all samples are fitted afterwards


def linear_start(
    records: Sequence[Record], n_states: int, *, lines: Lines | None, steps: int, feedthrough: bool
) -> Found:
    """Fit a linear state space: poles by subspaces, the rest by least squares, then everything by the free run."""
    starts = []
    for rows in sorted({max(n_states + 2, round(n_states * by)) for by in _ROWS} | {10, 20}):
        cuts = [(r.inputs[:, :_LONGEST], r.outputs[:, :_LONGEST]) for r in records if r.fitted > 4 * rows]
        if sum(record[0].shape[1] for record in cuts) > 8 * rows * (len(records[0].inputs) + len(records[0].outputs)):
            starts.append(from_samples(cuts, n_states, rows))
        if lines is not None and lines[1].size > rows:
            starts.append(from_lines(*lines, n_states, rows))
    if not starts:
        raise ModelError(f"the recordings are too short for {n_states} states: give longer ones, or fewer states")
    best = min((_fitted(a, c, records, feedthrough) for a, c in starts), key=lambda point: point.cost)
    system = _freed(best.system, feedthrough)
    return search(system, best.starts, records, steps=steps, patience=steps)


def _linear(a: Array, c: Array, m: int, feedthrough: bool) -> System:
    """Return the system without inputs, in which the weights of the inputs and the constant are free."""
    p, n = c.shape
    basis = Basis(n, m, 0, ())
    transition, output = np.zeros((n, basis.size)), np.zeros((p, basis.size))
    transition[:, 1 : 1 + n], output[:, 1 : 1 + n] = a, c
    weights = {"directions": np.zeros((0, basis.size)), "transition": transition, "output": output}
    free = {name: np.zeros_like(values, dtype=bool) for name, values in weights.items()}
    free["transition"][:, 1 + n :] = True
    free["output"][:, 0], free["output"][:, 1 + n :] = True, feedthrough
    return System.of(basis, weights, free)


def _freed(system: System, feedthrough: bool) -> System:
    transition, output = np.ones_like(system.free_transition), np.ones_like(system.free_output)
    transition[:, 0] = False  # a constant of the output has the same effect
    output[:, 1 + system.basis.states :] = feedthrough
    return replace(system, free_transition=transition, free_output=output)


def _fitted(a: Array, c: Array, records: Sequence[Record], feedthrough: bool) -> Point:
    """Fit B, D, the constant and the initial states, on which the outputs depend linearly."""
    system = _linear(a, c, len(records[0].inputs), feedthrough)
    point = judged(system, np.zeros((len(records), len(a))), records)
    rows = triangle(point, records)
    step = np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-12)[0], dtype=np.float64)
    n = system.theta.size
    return judged(system.with_theta(step[:n]), step[n:].reshape(point.starts.shape), records)


def in_own_coordinates(point: Point, records: Sequence[Record]) -> Point:
    """Transform the states to the first output and its changes, orthogonal and with an rms value of about one."""
    system, n = point.system, point.system.basis.states
    a, _, c, _ = system.linear_parts
    rows: list[Array] = []
    block = c
    while len(rows) < n * n:
        rows += list(block)
        block = block @ (a - np.eye(n))
    chosen: list[Array] = []
    for row in rows:
        if len(chosen) == n:
            break
        if np.linalg.matrix_rank(np.array([*chosen, row]), tol=1e-9 * np.linalg.norm(row)) > len(chosen):
            chosen.append(row)
    if len(chosen) < n:
        chosen = list(np.eye(n))
    turn = np.array(chosen)
    states = np.concatenate(
        [_states(system, start, record) for record, start in zip(records, point.starts, strict=True)], axis=1
    )
    seen = turn @ states
    spread = np.asarray(np.linalg.qr(seen.T / np.sqrt(seen.shape[1]), mode="r")).T
    spread = spread * np.sign(np.where(np.diag(spread) == 0.0, 1.0, np.diag(spread)))
    turn = np.linalg.lstsq(spread, turn, rcond=1e-10)[0]
    # Back to the states that occur: they span fewer than n directions if the order is higher than that of the data.
    left, sizes, _ = np.linalg.svd(states, full_matrices=False)
    occurring = left[:, sizes > 1e-10 * sizes[0]]
    back = occurring @ np.linalg.pinv(turn @ occurring)
    transition, output = system.transition.copy(), system.output.copy()
    transition = turn @ transition
    for weights in (transition, output):
        weights[:, 1 : 1 + n] = weights[:, 1 : 1 + n] @ back
    turned = judged(replace(system, transition=transition, output=output), point.starts @ turn.T, records)
    # Transforming a state that hardly affects the outputs loses digits; if the outputs lost more than half of theirs,
    # the coordinates stay.
    rounding = np.finfo(float).eps * sum(record.fitted for record in records) * len(output)
    return turned if turned.cost <= (1.0 + 1e-6) * point.cost + rounding else point


def _states(system: System, start: Array, record: Record) -> Array:
    """Return the states of a linear run, shape (n_states, n)."""
    n = system.basis.states
    reader = np.zeros((n, system.basis.size))
    reader[:, 1 : 1 + n] = np.eye(n)
    probe = replace(system, output=reader, free_output=np.zeros_like(reader, dtype=bool))
    return probe.run(record.inputs[:, : record.fitted], start)[0].T
