"""The run of a nonlinear state space over a record, with its sensitivities to all weights and to the first state.

x(k+1) = W phi(k), y(k) = V phi(k), with the regressors phi of states, inputs and directions s(k) = P phi(k). The march
is a small C kernel, and Python where there is no C compiler, or a function is the user's own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.free_run import ArrayPointer
from deatwin.ident.narx.shapes import switch_source
from deatwin.ident.nss.basis import Basis
from deatwin.ident.nss.document import WEIGHTS
from deatwin.plant.arrays import Array
from deatwin.plant.integrator.compiled import compiler, load_source

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class System:
    """Weights of a nonlinear state space, and masks of the free ones. Masks have the shapes of the weights."""

    basis: Basis
    directions: Array  # shape (n_directions, n_regressors): Weights P
    transition: Array  # shape (n_states, n_regressors): Weights W
    output: Array  # shape (n_outputs, n_regressors): Weights V
    free_directions: Mask
    free_transition: Mask
    free_output: Mask

    @classmethod
    def of(cls, basis: Basis, weights: Mapping[str, Array], free: Mapping[str, Mask]) -> System:
        """Return the system for given weights and masks of free weights, by the names of the fields."""
        fields: dict[str, Any] = {**weights, **{f"free_{name}": mask for name, mask in free.items()}}
        return cls(basis=basis, **fields)

    @cached_property
    def _pairs(self) -> tuple[tuple[Array, Mask], ...]:
        return tuple((getattr(self, name), getattr(self, f"free_{name}")) for name in WEIGHTS)

    @property
    def theta(self) -> Array:
        """Free weights of directions, transition and output, in this order, row by row."""
        return np.concatenate([weights[free] for weights, free in self._pairs])

    def with_theta(self, theta: Array) -> System:
        """Return the system with other free weights."""
        counts = np.cumsum([free.sum() for _, free in self._pairs])[:-1]
        new = []
        for (weights, free), values in zip(self._pairs, np.split(theta, counts), strict=True):
            new.append(weights.copy())
            new[-1][free] = values
        return replace(self, directions=new[0], transition=new[1], output=new[2])

    @property
    def linear_parts(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D: the weights of states and inputs."""
        n = self.basis.states
        states, inputs = slice(1, 1 + n), slice(1 + n, self.basis.linear)
        w, v = self.transition, self.output
        return w[:, states], w[:, inputs], v[:, states], v[:, inputs]

    def run(
        self, inputs: Array, start: Array, *, limit: float = np.inf, sensitive: bool = False
    ) -> tuple[Array, Array | None, int]:
        """Run until an output leaves the limit; return (n, n_outputs), derivatives by theta and start, samples run."""
        n = inputs.shape[1]
        tables, kernel = self.basis.tables, _kernel(compiler())
        outputs = np.full((n, len(self.output)), np.nan)
        gradient = np.empty((n, len(self.output), self.theta.size + start.size)) if sensitive else None
        if tables is None or kernel is None:
            return _plain(self, inputs, start, outputs, gradient, limit)
        basis, sizes = self.basis, [int(free.sum()) for _, free in self._pairs]
        weights = [np.ascontiguousarray(values, dtype=np.float64) for values, _ in self._pairs]
        places = [np.flatnonzero(free).astype(np.int64) for _, free in self._pairs]
        held = [*tables, *weights, *places]
        described = _Tables(
            *(basis.states, basis.inputs, basis.directions, len(self.output), basis.size, *sizes),
            *(array.ctypes.data for array in held),
            limit if np.isfinite(limit) else np.finfo(float).max,
        )
        u, x = np.ascontiguousarray(inputs.T), np.array(start, dtype=np.float64)
        reached = kernel.deatwin_states(ctypes.byref(described), n, u, x, outputs, gradient, self._work())
        return outputs, gradient, int(reached)

    def sensitivities(self, inputs: Array, start: Array) -> tuple[Array, Array]:
        """Return outputs of a whole run and their derivatives, with the shapes that `run` returns."""
        outputs, gradient, _ = self.run(inputs, start, sensitive=True)
        if gradient is None:
            raise ValueError("a sensitive run has a gradient")
        return outputs, gradient

    def _work(self) -> Array:
        basis, (p, n) = self.basis, (len(self.output), self.basis.states)
        width = n + basis.inputs + basis.directions
        size = basis.size * (1 + width + n) + (n + p) * (n + basis.directions) + width + n + (1 + basis.directions) ** 2
        return np.empty(size + 2 * n * (self.theta.size + n))


def _plain(
    system: System, inputs: Array, start: Array, outputs: Array, gradient: Array | None, limit: float
) -> tuple[Array, Array | None, int]:
    """Run in Python: first the states, then all derivatives at once."""
    basis, n = system.basis, inputs.shape[1]
    z = np.zeros((len(basis.names), n))
    state, reached, lin = start, n, basis.linear - 1
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n):
            z[:lin, k] = np.concatenate([state, inputs[:, k]])
            phi = basis.values(z[:, k : k + 1], system.directions)[:, 0]
            outputs[k] = system.output @ phi
            if not np.all(np.abs(outputs[k]) < limit):
                outputs[k], reached = np.nan, k
                break
            state = system.transition @ phi
    if gradient is None or reached < n:
        return outputs, gradient, reached
    phi, slopes = basis.values(z, system.directions), basis.slopes(z)
    early = system.directions * (basis.levels < np.arange(1, 1 + basis.directions)[:, None])
    # A direction moves with what is added to it and to the earlier directions that it uses.
    chain = np.linalg.inv(np.eye(basis.directions) - early @ slopes[:, :, lin:])
    total = slopes[:, :, : basis.states] + slopes[:, :, lin:] @ chain @ early @ slopes[:, :, : basis.states]
    moving = slopes[:, :, lin:] @ chain
    ahead, seen = system.transition @ total, system.output @ total
    sizes = [int(free.sum()) for _, free in system._pairs]
    inner, moved = sizes[0], sizes[0] + sizes[1]
    rows, columns = np.nonzero(system.free_directions)
    below = phi[columns]
    explicit = np.zeros((n, basis.states, moved + basis.states))
    explicit[:, :, :inner] = (system.transition @ moving)[:, :, rows] * below.T[:, None, :]
    for f, (i, j) in enumerate(zip(*np.nonzero(system.free_transition), strict=True), start=inner):
        explicit[:, i, f] = phi[j]
    sensitivity = np.zeros((basis.states, moved + basis.states))
    sensitivity[:, moved:] = np.eye(basis.states)
    gradient[:] = 0.0
    for k in range(n):
        known = seen[k] @ sensitivity
        gradient[k, :, :moved], gradient[k, :, moved + sizes[2] :] = known[:, :moved], known[:, moved:]
        sensitivity = ahead[k] @ sensitivity + explicit[k]
    gradient[:, :, :inner] += (system.output @ moving)[:, :, rows] * below.T[:, None, :]
    for f, (i, j) in enumerate(zip(*np.nonzero(system.free_output), strict=True), start=moved):
        gradient[:, i, f] += phi[j]
    return outputs, gradient, reached


class _Tables(ctypes.Structure):
    """The model in the kernel's format; the system keeps its arrays alive."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("n", "m", "k", "p", "r", "inner", "rates", "readings")),
        *(
            (name, ctypes.c_void_p)
            for name in ("start", "factors", "numbers", "level", "P", "W", "V", "atP", "atW", "atV")
        ),
        ("limit", ctypes.c_double),
    ]


@lru_cache(maxsize=4)
def _kernel(_program: str | None) -> ctypes.CDLL | None:
    """Return the compiled kernel, or None if there is no compiler."""
    kernel = load_source(switch_source() + Path(__file__).with_suffix(".c").read_text(encoding="utf-8"))
    if kernel is None:
        return None
    kernel.deatwin_states.restype = ctypes.c_int64
    kernel.deatwin_states.argtypes = (ctypes.c_void_p, ctypes.c_int64, *(ArrayPointer,) * 5)
    return kernel
