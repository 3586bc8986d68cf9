"""Poles and output map of a linear state space by subspace identification, from lines or from samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.plant.arrays import Array, Complex

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
