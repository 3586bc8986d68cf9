"""The linear state space from which a nonlinear one starts, by subspace identification; its states are the output and its changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.nss.basis import Basis
from deatwin.ident.nss.march import System
from deatwin.ident.nss.search import Found, Point, Record, judged, search, triangle
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.errors import ModelError

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
