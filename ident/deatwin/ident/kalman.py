"""One Kalman filter and fixed-interval smoother, with the likelihood and its gradient.

The model is x(k+1) = F_k x(k) + c_k + w(k), y_i(k) = h_ik' x(k) + v_i(k), white normal w ~ (0, Q_k), v_i ~ (0, R_i).
Numbers are taken in one at a time (Potter's update [1]_). Covariances are carried as roots, P = S S', also by the
recursion of Rauch, Tung and Striebel: nothing is subtracted, so a start may be as wide, or as exactly known, as one
likes. An extended filter linearises as it goes, by `update_root` and `advance_root`, and `kalman_filter` repeats it for
the smoother as the filter of the linear model with c_k = f(x) - F_k x.

.. [1] Bierman, "Factorization Methods for Discrete Sequential Estimation", Academic Press 1977, ch. V.
.. [2] de Jong, J. Am. Stat. Assoc. 84 (1989) 1085-1088.
.. [3] Koopman, Shephard, Biometrika 79 (1992) 823-826, doi:10.1093/biomet/79.4.823.
.. [4] Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445-1450, doi:10.2514/3.3166; in roots: Park, Kailath, IEEE Trans.
   Autom. Control 41 (1996) 727-732.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import log, pi, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack, solve_triangular

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.integrator.compiled import compiler, load_source

_NOT_NEGATIVE = 1e-10  # eigenvalues of a correlation matrix below minus this are not rounding errors


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    """A linear state-space model over one record; each matrix is constant or given per sample."""

    rows: Array  # h_ik, output unit by unit of the state, shape (n_outputs, n, n_states) or (n, n_states)
    noise_variance: Array  # R_i of the noise, uncorrelated between outputs, shape (n_outputs,) or ()
    start: Array  # shape (n_states,): Mean of the state at the first sample, before its measurement
    start_cov: Array  # shape (n_states, n_states): Covariance of that state; zero where it is known exactly
    transition: Array | None = None  # F_k from sample k to k + 1, shape ([n - 1,] n_states, n_states); identity if None
    added: Array | None = None  # shape (n - 1, n_states): c_k, effect of known inputs on the state after sample k
    process_cov: Array | None = None  # Q_k of the noise added after sample k, shape as `transition`; zero if None
    intervals: Array | None = None  # shape (n - 1,): Factors on Q_k, for a random walk over a gap; 1 if None
    fading: float = 1.0
    """Forgetting factor in (0, 1] by which the covariance is divided in each step (recursive least squares with
    forgetting). Below 1 the likelihood and the smoother have no meaning."""

    def __post_init__(self) -> None:
        rows = np.asarray(self.rows, dtype=np.float64)
        rows = rows[None] if rows.ndim == 2 else rows
        if rows.ndim != 3 or 0 in rows.shape:
            raise ModelError(f"rows have the shape {rows.shape}; it must be (n_outputs, n, n_states)")
        p, n, m = rows.shape
        object.__setattr__(self, "rows", frozen(rows))
        shapes: dict[str, tuple[tuple[int, ...], ...]] = {
            "noise_variance": ((p,), (1,)),
            "start": ((m,),),
            "start_cov": ((m, m),),
            "transition": ((m, m), (n - 1, m, m)),
            "process_cov": ((m, m), (n - 1, m, m)),
            "intervals": ((n - 1,),),
            "added": ((n - 1, m),),
        }
        for name, allowed in shapes.items():
            given = getattr(self, name)
            if given is None:
                continue
            values = np.atleast_1d(np.asarray(given, dtype=np.float64))
            if values.shape not in allowed:
                wanted = " or ".join(map(str, allowed))
                raise ModelError(f"{name} has the shape {values.shape}; {p} rows of shape ({n}, {m}) need {wanted}")
            object.__setattr__(self, name, frozen(values))
        if self.noise_variance.shape != (p,):
            object.__setattr__(self, "noise_variance", frozen(np.full(p, self.noise_variance[0])))
        if not (np.all(self.noise_variance >= 0) and 0 < self.fading <= 1):
            raise ModelError(
                f"noise_variance = {self.noise_variance} must not be negative, "
                f"fading = {self.fading} must lie above 0 and not above 1"
            )

    @cached_property
    def process_root(self) -> Array | None:
        """Transposed roots G' with G G' = Q, shape (r, n_states) or (n - 1, r, n_states); None for no noise."""
        if self.process_cov is None or not self.process_cov.any():
            return None
        across = covariance_root(self.process_cov).swapaxes(-1, -2)
        return frozen(across[across.any(axis=1)] if across.ndim == 2 else across)


def covariance_root(covariance: Array) -> Array:
    """Return G with G G' = covariance. Shapes: `covariance` (n, n); returns (n, n)."""
    scale = np.sqrt(np.abs(np.einsum("...ii->...i", covariance)))
    divisor = np.where(scale > 0, scale, 1.0)
    correlation = covariance / (divisor[..., :, None] * divisor[..., None, :])
    values, axes = np.linalg.eigh(correlation)
    even = np.allclose(correlation, correlation.swapaxes(-1, -2), rtol=0, atol=1e-8)
    if not (even and np.all(np.isfinite(values)) and np.all(values > -_NOT_NEGATIVE * values.shape[-1])):
        raise ModelError("a covariance must be finite, symmetric and positive semidefinite")
    return np.asarray(divisor[..., :, None] * axes * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def frozen(values: Array) -> Array:
    """Return `values` as a contiguous array of floats that cannot be written to."""
    array = np.ascontiguousarray(values, dtype=np.float64).view()
    array.setflags(write=False)
    return array


@dataclass(frozen=True, kw_only=True, eq=False)
class Filtered:
    """State estimates of the filter after each sample."""

    model: StateSpace
    states: Array  # shape (n, n_states): Mean given the measurements up to and including each sample
    roots: Array  # shape (n, n_states, n_states): Roots S of the covariance S S'
    innovations: Array
    """Measurement minus its prediction from all earlier ones (at the same sample, from outputs of lower number), shape
    (n_outputs, n); NaN where the measurement is missing."""
    innovation_variances: Array  # shape (n_outputs, n), all positive
    gains: Array  # shape (n_outputs, n, n_states): Change of the state per unit of each innovation

    @cached_property
    def n_measured(self) -> int:
        """Number of measurements, without the missing ones."""
        return int(np.isfinite(self.innovations).sum())

    @cached_property
    def log_likelihood(self) -> float:
        """Exact log likelihood of the measurements under the model, including the start."""
        variance, square = self.innovation_variances, self.innovations**2
        terms = np.where(np.isnan(square), 0.0, np.log(2 * pi * variance) + square / variance)
        return -0.5 * float(terms.sum())

    @property
    def variance_factor(self) -> float:
        """Common factor on all covariances (R, Q and that of the start) that maximises the likelihood."""
        return float(np.nansum(self.innovations**2 / self.innovation_variances)) / self.n_measured

    @property
    def scaled_log_likelihood(self) -> float:
        """Log likelihood after all covariances are multiplied by `variance_factor`."""
        logs = np.where(np.isnan(self.innovations), 0.0, np.log(self.innovation_variances))
        return -0.5 * (float(logs.sum()) + self.n_measured * (log(2 * pi * self.variance_factor) + 1.0))

    @property
    def covariances(self) -> Array:
        """Covariance of the state after each sample, shape (n, n_states, n_states)."""
        return np.asarray(self.roots @ self.roots.swapaxes(1, 2))

    @property
    def std(self) -> Array:
        """Standard deviations of the state after each sample, shape (n, n_states)."""
        return np.asarray(np.sqrt(np.einsum("kij,kij->ki", self.roots, self.roots)), dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothed:
    """State estimates from all measurements."""

    states: Array  # shape (n, n_states): Means
    covariances: Array  # shape (n, n_states, n_states)
    gains: Array  # shape (n - 1, n_states, n_states): Change of a smoothed state per change of the next one
    log_likelihood: float  # Log likelihood from the filter

    @property
    def std(self) -> Array:
        """Standard deviations, shape (n, n_states)."""
        variances = np.einsum("kii->ki", self.covariances)  # differences, so rounding may turn a zero negative
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)), dtype=np.float64)


def kalman_filter(model: StateSpace, outputs: ArrayLike) -> Filtered:
    """Filter one record. Shapes: `outputs` (n_outputs, n) or (n,), NaN where a measurement is missing."""
    p, n, _ = model.rows.shape
    measured = np.atleast_2d(np.asarray(outputs, dtype=np.float64))
    if measured.shape != (p, n):
        raise ModelError(f"the outputs have the shape {measured.shape}; the model's rows need {(p, n)}")
    states, roots, innovations, variances, gains = forward(model, np.ascontiguousarray(measured))
    return Filtered(
        model=model, states=states, roots=roots, innovations=innovations, innovation_variances=variances, gains=gains
    )


def adjoint(filtered: Filtered) -> tuple[Array, Array]:
    """Return gradients of the log likelihood by the states, (n, n_states), and minus second derivatives [2]_, [3]_."""
    _require_no_fading(filtered.model)
    return backward(filtered.model, filtered.innovations, filtered.innovation_variances, filtered.gains)


def kalman_smoother(filtered: Filtered) -> Smoothed:
    """Return mean and covariance of each state, given the whole record [4]_."""
    _require_no_fading(filtered.model)
    states, covariances, gains = smooth(filtered.model, filtered.states, filtered.roots)
    return Smoothed(states=states, covariances=covariances, gains=gains, log_likelihood=filtered.log_likelihood)


def _require_no_fading(model: StateSpace) -> None:
    if model.fading != 1.0:
        raise ModelError("a fading filter has no likelihood and no smoother; take fading = 1")


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
    kernel = load_source(Path(__file__).with_name("kalman.c").read_text(encoding="utf-8"))
    if kernel is None:
        return None
    kernel.deatwin_filter.restype = ctypes.c_int64
    kernel.deatwin_filter.argtypes = (ctypes.c_void_p,) * 10
    kernel.deatwin_adjoint.restype = kernel.deatwin_smoother.restype = None
    kernel.deatwin_adjoint.argtypes = (ctypes.c_void_p,) * 7
    kernel.deatwin_smoother.argtypes = (ctypes.c_void_p,) * 7
    return kernel
