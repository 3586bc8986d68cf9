"""The steps of the Kalman filter and of its adjoint, and their march along a record.

The march is a small C kernel, compiled once per user, where a C compiler is found, and Python elsewhere; the steps
stand by themselves for filters that linearise as they go.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from math import sqrt
from pathlib import Path

import numpy as np
from scipy.linalg import lapack, solve_triangular

from deatwin.ident.state_space import StateSpace, covariance_root
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.integrator.compiled import compile_source, compiler


def update_root(root: Array, row: Array, noise_variance: float) -> tuple[Array, Array, float]:
    """Include a measurement by Potter's formula; update gain (n_states,) and covariance root; `row` (n_states,)."""
    seen = row @ root
    variance = float(seen @ seen) + noise_variance
    if not variance > 0.0:
        raise ModelError("a measurement without noise of a state that is known exactly: give a noise variance")
    moved = root @ seen
    shrink = 1.0 / (variance + sqrt(noise_variance * variance))
    return root - (shrink * moved)[:, None] * seen, moved / variance, variance


def advance_root(root: Array, transition: Array | None, process_root: Array | None) -> Array:
    """Advance a root (n_states, n_states) of the covariance by a step: P becomes F P F' + G G'."""
    moved = root if transition is None else transition @ root
    if process_root is None:
        return moved
    m = root.shape[0]
    stacked = np.empty((m + len(process_root), m), order="F")
    stacked[:m] = moved.T
    stacked[m:] = process_root
    return np.asarray(np.tril(lapack.dgeqrf(stacked, overwrite_a=1)[0][:m].T))


def forward(model: StateSpace, outputs: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Filter a record. Shapes: `outputs` (n_outputs, n)."""
    p, n, m = model.rows.shape
    found = (np.empty((n, m)), np.empty((n, m, m)), np.full((p, n), np.nan), np.empty((p, n)), np.zeros((p, n, m)))
    root = covariance_root(model.start_cov)
    kernel = _kernel(compiler())
    if kernel is None:
        reached = _plain_forward(model, outputs, root, *found)
    else:
        tables, state, across = _tables(model), model.start.copy(), root.T.copy()
        work = np.empty((m + tables.r + 1) * m)
        reached = kernel.deatwin_filter(
            ctypes.byref(tables), *(array.ctypes.data for array in (outputs, state, across, *found, work))
        )
    if reached < n:
        raise ModelError(f"the measurement at sample {reached} was certain beforehand: give it a noise variance")
    return found


def backward(model: StateSpace, innovations: Array, variances: Array, gains: Array) -> tuple[Array, Array]:
    """Run the filter's adjoint. Shapes: `innovations, variances` (n_outputs, n); `gains` (n_outputs, n, n_states)."""
    _, n, m = model.rows.shape
    found = np.empty((n, m)), np.empty((n, m, m))
    kernel = _kernel(compiler())
    if kernel is None:
        _plain_backward(model, innovations, variances, gains, *found)
    else:
        tables, work = _tables(model), np.empty((2 * m + 3) * m)
        arrays = [np.ascontiguousarray(array) for array in (innovations, variances, gains)]
        kernel.deatwin_adjoint(ctypes.byref(tables), *(array.ctypes.data for array in (*arrays, *found, work)))
    return found


def smooth(model: StateSpace, states: Array, roots: Array) -> tuple[Array, Array, Array]:
    """Run the smoother. Shapes: `states` (n, n_states); `roots` (n, n_states, n_states)."""
    n, m = states.shape
    found = np.empty((n, m)), np.empty((n, m, m)), np.empty((n - 1, m, m))
    kernel = _kernel(compiler())
    if kernel is None:
        _plain_smooth(model, states, roots, *found)
    else:
        tables = _tables(model)
        arrays = [np.ascontiguousarray(array) for array in (states, roots)]
        work = np.empty((3 * m + 2 * tables.r + 4) * m)
        kernel.deatwin_smoother(ctypes.byref(tables), *(array.ctypes.data for array in (*arrays, *found, work)))
    return found


def _plain_forward(
    model: StateSpace,
    outputs: Array,
    root: Array,
    states: Array,
    roots: Array,
    innovations: Array,
    variances: Array,
    gains: Array,
) -> int:
    """Filter in Python; return the number of a sample whose measurement was certain beforehand, else n."""
    noise, values, fade = model.noise_variance.tolist(), outputs.T.tolist(), 1.0 / sqrt(model.fading)
    state = model.start
    for k in range(len(states)):
        if k:
            transition, process_root = _step(model, k - 1)
            state = _ahead(model, k - 1, transition, state)
            root = advance_root(root if fade == 1.0 else fade * root, transition, process_root)
        for i, value in enumerate(values[k]):
            row = model.rows[i, k]
            if value != value:  # missing
                seen = row @ root
                variances[i, k] = seen @ seen + noise[i]
                continue
            try:
                root, gain, variances[i, k] = update_root(root, row, noise[i])
            except ModelError:
                return k
            innovations[i, k] = innovation = value - float(row @ state)
            state = state + gain * innovation
            gains[i, k] = gain
        states[k], roots[k] = state, root
    return len(states)


def _plain_backward(
    model: StateSpace, innovations: Array, variances: Array, gains: Array, vectors: Array, matrices: Array
) -> None:
    """Run the adjoint in Python."""
    p, n, m = model.rows.shape
    vector, matrix = np.zeros(m), np.zeros((m, m))
    for k in range(n - 1, -1, -1):
        transition = _step(model, k)[0] if k < n - 1 else None
        if transition is not None:
            vector, matrix = transition.T @ vector, transition.T @ matrix @ transition
        for i in range(p - 1, -1, -1):
            innovation, variance = float(innovations[i, k]), float(variances[i, k])
            if innovation != innovation:  # missing
                continue
            row, gain = model.rows[i, k], gains[i, k]
            # With L = I - gain row': vector <- L'vector + row v/s, matrix <- L'matrix L + row row'/s.
            pulled = matrix @ gain
            weight = float(gain @ pulled) + 1.0 / variance
            error = innovation / variance - float(gain @ vector)
            vector = vector + error * row
            half = (pulled - (0.5 * weight) * row)[:, None] * row
            matrix = matrix - half - half.T
        vectors[k], matrices[k] = vector, matrix


def _plain_smooth(
    model: StateSpace, filtered: Array, roots: Array, states: Array, covariances: Array, gains: Array
) -> None:
    """Smooth in Python."""
    n, m = filtered.shape
    states[-1], covariances[-1] = filtered[-1], roots[-1] @ roots[-1].T
    for k in range(n - 2, -1, -1):
        transition, process_root = _step(model, k)
        root, sources = roots[k], 0 if process_root is None else len(process_root)
        # Root of the joint covariance of x(k + 1) and x(k), triangularised: (R, B; 0, D).
        joint = np.zeros((m + sources, 2 * m))
        joint[:m, :m] = (root if transition is None else transition @ root).T
        joint[:m, m:] = root.T
        if process_root is not None:
            joint[m:, :m] = process_root
        joint = np.asarray(np.linalg.qr(joint, mode="r"))
        never = np.flatnonzero(np.diag(joint)[:m] == 0.0)
        joint[never] = 0.0
        joint[never, never] = 1.0
        gain = solve_triangular(joint[:m, :m], joint[:m, m:]).T
        states[k] = filtered[k] + gain @ (states[k + 1] - _ahead(model, k, transition, filtered[k]))
        covariance = gain @ covariances[k + 1] @ gain.T + joint[m:, m:].T @ joint[m:, m:]
        covariances[k], gains[k] = 0.5 * (covariance + covariance.T), gain


def _step(model: StateSpace, k: int) -> tuple[Array | None, Array | None]:
    """Return the transition from sample k to the next, and the transposed root of its process covariance."""
    transition, root = model.transition, model.process_root
    if transition is not None and transition.ndim == 3:
        transition = transition[k]
    if root is not None:
        root = root[k] if root.ndim == 3 else root
        root = root if model.intervals is None else sqrt(model.intervals[k]) * root
    return transition, root


def _ahead(model: StateSpace, k: int, transition: Array | None, state: Array) -> Array:
    """Advance a state from sample k to the next."""
    moved = state if transition is None else transition @ state
    return moved if model.added is None else moved + model.added[k]


class _Tables(ctypes.Structure):
    """The model in the kernel's format; the StateSpace keeps its arrays alive."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("p", "n", "m", "r")),
        *((name, ctypes.c_void_p) for name in ("rows", "noise", "transition")),
        ("transition_stride", ctypes.c_int64),
        ("process", ctypes.c_void_p),
        ("process_stride", ctypes.c_int64),
        ("added", ctypes.c_void_p),
        ("intervals", ctypes.c_void_p),
        ("fade", ctypes.c_double),
    ]


def _tables(model: StateSpace) -> _Tables:
    """Convert the model to the kernel's format."""

    def address(array: Array | None) -> int | None:
        return None if array is None else array.ctypes.data

    def stride(array: Array | None) -> int:
        return array[0].size if array is not None and array.ndim == 3 and len(array) else 0

    root = model.process_root
    sources = 0 if root is None else root.shape[-2]
    return _Tables(
        *model.rows.shape,
        sources,
        address(model.rows),
        address(model.noise_variance),
        address(model.transition),
        stride(model.transition),
        address(root),
        stride(root),
        address(model.added),
        address(model.intervals),
        1.0 / sqrt(model.fading),
    )


@lru_cache(maxsize=4)
def _kernel(_program: str | None) -> ctypes.CDLL | None:
    """Return the compiled kernel, or None if there is no compiler."""
    library = compile_source(Path(__file__).with_name("kalman.c").read_text(encoding="utf-8"))
    if library is None:
        return None
    kernel = ctypes.CDLL(str(library))
    kernel.deatwin_filter.restype = ctypes.c_int64
    kernel.deatwin_filter.argtypes = (ctypes.c_void_p,) * 10
    kernel.deatwin_adjoint.restype = kernel.deatwin_smoother.restype = None
    kernel.deatwin_adjoint.argtypes = (ctypes.c_void_p,) * 7
    kernel.deatwin_smoother.argtypes = (ctypes.c_void_p,) * 7
    return kernel
