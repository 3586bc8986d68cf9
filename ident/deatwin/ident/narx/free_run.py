"""Simulate NARX models from their own past outputs: free runs, innovations, and the errors of many models.

The march over known factors and products of the simulated signal is a small C kernel, and plain Python without a
compiler.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.shapes import SOURCES, Shape, switch_source
from deatwin.ident.narx.terms import Term, TermTable, Variable
from deatwin.plant.arrays import Array, Booleans, Integers
from deatwin.plant.errors import ModelError
from deatwin.plant.integrator.compiled import compiler, load_source

Factors = tuple[tuple[int, int], ...]  # Product of signals: for each factor the row of the signal and its lag

_BLOCK = 256  # samples of a block, as in the kernel
_HORIZONS = 4096  # runs simulated at once, whose regressors stay in the processor's cache


def free_run(
    table: TermTable, theta: Array, inputs: Array, outputs: Array, limit: float, equations: Sequence[int] | None = None
) -> tuple[Array, int | None]:
    """Simulate without noise until `limit` is exceeded; return (n_outputs, n) and the sample of a divergence."""
    quiet = [i for i, term in enumerate(table.terms) if all(v.kind != "e" for v, _ in term.factors)]
    terms = [table.terms[i] for i in quiet]
    belongs = None if equations is None else [equations[i] for i in quiet]
    march = March.of(terms, {"u": inputs}, "y", outputs, first=table.max_lag, equations=belongs)
    return march.run(np.asarray(theta)[quiet], limit=limit)


def innovations(
    table: TermTable, theta: Array, inputs: Array, outputs: Array, equations: Sequence[int] | None = None
) -> Array:
    """Return e(k) = y(k) - sum_m theta_m term_m(k), (n_outputs, n), from measured signals and past e."""
    start, known = np.zeros_like(outputs, dtype=np.float64), {"u": inputs, "y": outputs}
    march = March.of(table.terms, known, "e", start, first=table.max_lag, equations=equations)
    return march.run(-np.asarray(theta), base=outputs)[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class March:
    """Terms over recordings that follow one another, arranged for a recursion over the samples of each."""

    known: Array  # shape (n_known, n): Signals that are known beforehand
    start: Array  # shape (n_marched, n): Signals to compute; only the samples before ``first`` of a recording are used
    first: int  # First sample of each recording to be computed
    ends: Integers  # shape (n_recordings,): Sample after each recording
    derived: tuple[tuple[int, Shape], ...]  # Functions of marched signals, the last rows of ``start``, with their rows
    parts: tuple[Factors, ...]  # Known factors of each term
    monomials: tuple[Factors, ...]  # Products of marched signals that occur in the terms
    monomial: Integers  # shape (n_terms,): Position of each term's monomial
    equations: Integers  # shape (n_terms,): Marched signal to whose equation each term belongs

    @classmethod
    def of(
        cls,
        terms: Sequence[Term],
        known: Mapping[str, Array],
        marched: str,
        start: Array,
        *,
        first: int,
        equations: Sequence[int] | None = None,
        alone: int | None = None,
        ends: Sequence[int] | Integers | None = None,
    ) -> March:
        """Arrange terms over `known` signals (n_channels, n) by kind and the `start` (n_marched, n) of the run."""
        rows = [row for signal in known.values() for row in np.asarray(signal, dtype=np.float64)]
        heights = accumulate([0, *(len(signal) for signal in known.values())])
        begins = dict(zip(known, heights, strict=False))
        computed = list(np.asarray(start, dtype=np.float64))
        derived: dict[tuple[int, Shape], int] = {}
        known_derived: dict[tuple[int, Shape], int] = {}

        def marches(v: Variable) -> bool:
            return v.kind == marched and alone in (None, v.index)

        def row_of(v: Variable) -> int:
            """Return the row of a variable's values; a function gets its row when it first occurs."""
            row = begins[v.kind] + v.index if not marches(v) else v.index if alone is None else 0
            if v.shape is None:
                return row
            signals, found = (computed, derived) if marches(v) else (rows, known_derived)
            if (row, v.shape) not in found:
                found[row, v.shape] = len(signals)
                signals.append(v.shape.along(signals[row]))
            return found[row, v.shape]

        parts = tuple(tuple((row_of(v), v.lag) for v in term.expanded if not marches(v)) for term in terms)
        products = [tuple((row_of(v), v.lag) for v in term.expanded if marches(v)) for term in terms]
        place = {product: j for j, product in enumerate(dict.fromkeys(products))}
        return cls(
            known=np.array(rows),
            start=np.array(computed),
            first=first,
            ends=np.array([len(computed[0])] if ends is None else ends, dtype=np.int64),
            derived=tuple(derived),
            parts=parts,
            monomials=tuple(place),
            monomial=np.array([place[product] for product in products], dtype=np.int64),
            equations=np.array([0] * len(terms) if equations is None else equations, dtype=np.int64),
        )

    def run(
        self, theta: Array, *, limit: float | Array = math.inf, base: Array | None = None
    ) -> tuple[Array, int | None]:
        """Run one model until a first divergence. Shapes: `theta` (n_terms,); `base`, the result (n_marched, n)."""
        x = self.start.copy()
        chosen = np.argsort(self.equations, kind="stable")
        theta = np.ascontiguousarray(theta, dtype=np.float64)[chosen]
        base = None if base is None else np.ascontiguousarray(base, dtype=np.float64)
        limits = self._limits(limit)
        kernel = self._kernel
        if kernel is None:
            reached = self._plain(chosen, theta, base, limits, x)
        else:
            terms, work = ctypes.byref(self._tables), self._work(chosen.size)
            reached = kernel.deatwin_run(terms, chosen.size, chosen, theta, base, limits, x, *work)
        x = x[: self.n_outputs]
        if reached == x.shape[1]:
            return x, None
        x[:, reached:] = x[:, [reached - 1]] if reached else 0.0
        return x, int(reached)

    def squared_errors(
        self, chosen: Integers, theta: Array, *, limit: float | Array, sections: Sequence[int] | Integers | int = 1
    ) -> Array:
        """Squared errors (n_models, n_sections) of `chosen`, `theta` (n_models, n_terms); infinite if any diverges."""
        chosen = np.ascontiguousarray(chosen, dtype=np.int64)
        theta = np.ascontiguousarray(theta, dtype=np.float64)
        starts, stops = self._sections(sections)
        limits = self._limits(limit)
        sums = np.empty((len(chosen), starts.size))
        kernel = self._kernel
        if kernel is None:
            for into, model in zip(sums, zip(chosen, theta, strict=True), strict=True):
                into[:] = self._plain_errors(*model, limits, starts, stops)
            return sums
        terms, run, work = ctypes.byref(self._tables), self.start.copy(), self._work(chosen.shape[1])
        data = (starts.size, starts, stops, self.start, limits)
        kernel.deatwin_errors(terms, *chosen.shape, chosen, theta, *data, sums, run, *work)
        return sums

    def _limits(self, limit: float | Array) -> Array:
        """Return the limit of each recording."""
        return np.ascontiguousarray(np.broadcast_to(np.asarray(limit, dtype=np.float64), self.ends.shape))

    def _sections(self, counts: Sequence[int] | Integers | int) -> tuple[Integers, Integers]:
        """Return the first sample of each section and the one after its last."""
        begins = np.concatenate([[0], self.ends[:-1]]) + self.first
        parts = zip(begins, self.ends, np.broadcast_to(counts, self.ends.shape), strict=True)
        edges = [(begin + (np.arange(n + 1) * (end - begin)) // n).astype(np.int64) for begin, end, n in parts]
        return np.concatenate([edge[:-1] for edge in edges]), np.concatenate([edge[1:] for edge in edges])

    def _plain_errors(self, chosen: Integers, theta: Array, limits: Array, starts: Integers, stops: Integers) -> Array:
        """Return the sums of squared errors of one model, without the kernel."""
        x = self.start.copy()
        if self._plain(chosen, theta, None, limits, x) < x.shape[1]:
            return np.full(stops.size, math.inf)
        total = np.concatenate([[0.0], np.cumsum((self.start[0] - x[0]) ** 2)])
        return total[stops] - total[starts]

    def _plain(self, chosen: Integers, theta: Array, base: Array | None, limits: Array, x: Array) -> int:
        """Run the recursion in Python; return the sample of the first divergence, or n."""
        n = x.shape[1]
        slots = list(dict.fromkeys((int(self.equations[i]), int(self.monomial[i])) for i in chosen))
        coefficients = np.zeros((len(slots), n - self.first))
        for i, value in zip(chosen, theta, strict=True):
            part = np.full(n - self.first, value)
            for row, lag in self.parts[i]:
                part *= self.known[row, self.first - lag : n - lag]
            coefficients[slots.index((int(self.equations[i]), int(self.monomial[i])))] += part
        products = [(c, self.monomials[j]) for c, j in slots]
        bases = np.zeros((self.n_outputs, n)) if base is None else base
        runs: list[list[float]] = x.tolist()
        reached = n
        rows = coefficients.T.tolist()
        begins = [0, *self.ends[:-1].tolist()]
        for k, limit in (
            (k, limit)
            for begin, end, limit in zip(begins, self.ends.tolist(), limits.tolist(), strict=True)
            for k in range(begin + self.first, end)
        ):
            values = bases[:, k].tolist()
            for product, (c, factors) in zip(rows[k - self.first], products, strict=True):
                for channel, lag in factors:
                    product *= runs[channel][k - lag]
                values[c] += product
            if not all(-limit < value < limit for value in values):
                reached = k
                break
            for run, value in zip(runs, values, strict=False):
                run[k] = value
            for run, (source, shape) in zip(runs[self.n_outputs :], self.derived, strict=True):
                change = runs[source][k] - (runs[source][k - shape.difference] if shape.difference else 0.0)
                run[k] = float(shape.value(np.array(change)))
        x[:] = runs
        return reached

    @cached_property
    def _tables(self) -> _Terms:
        """Return the terms in the kernel's format."""
        n = self.start.shape[1]
        numbers = np.array(
            [
                (row, SOURCES.index(f.name), f.difference, f.gain, f.unit, *(*f.parameters, 0.0, 0.0)[:2])
                for row, f in self.derived
            ]
        ).reshape(-1, 7)
        flat = (*_flat(self.parts, n), self.monomial, self.equations, *_flat(self.monomials, n))
        arrays = (self.known, *flat, numbers, self.ends)
        addresses = (array.ctypes.data for array in arrays)
        tables = _Terms(*addresses, self.n_outputs, len(numbers), self.ends.size, self.first, n)
        tables.keep = arrays
        return tables

    @property
    def n_outputs(self) -> int:
        """Number of signals that have equations."""
        return self.start.shape[0] - len(self.derived)

    @property
    def _kernel(self) -> ctypes.CDLL | None:
        """Return the compiled kernel; None without a compiler, or if a function exists only in Python."""
        return _kernel(compiler()) if all(shape.source for _, shape in self.derived) else None

    def _work(self, n_terms: int) -> tuple[Integers, Array]:
        """Return working memory for the kernel."""
        return np.empty(3 * n_terms + self.n_outputs, dtype=np.int64), np.empty(max(n_terms, 1) * _BLOCK)


def _flat(products: Sequence[Factors], n: int) -> tuple[Integers, Integers]:
    """List products one after another: the start of each, and the offset of each factor in the first row."""
    starts = np.array([0, *accumulate(len(product) for product in products)], dtype=np.int64)
    offsets = np.array([row * n - lag for product in products for row, lag in product] or [0], dtype=np.int64)
    return starts, offsets


class ArrayPointer(ctypes.c_void_p):
    """Type of an argument of a C function: the data of a contiguous array; a null pointer for None."""

    @classmethod
    def from_param(cls, value: Any, /) -> Any:
        """Convert an array, or None."""
        return cls(None if value is None else value.ctypes.data)


class _Terms(ctypes.Structure):
    """``terms`` of the kernel; the arrays that it points to are kept in ``keep``."""

    keep: tuple[NDArray[np.generic], ...]
    _POINTERS = "known known_start known_offset monomial equation marched_start marched_offset shapes ends"
    _fields_ = [
        *((name, ctypes.c_void_p) for name in _POINTERS.split()),
        *((name, ctypes.c_int64) for name in ("n_outputs", "n_shapes", "n_records", "first", "n")),
    ]


@lru_cache(maxsize=4)
def _kernel(_program: str | None) -> ctypes.CDLL | None:
    """Return the compiled kernel, or None if there is no compiler."""
    kernel = load_source(switch_source() + Path(__file__).with_suffix(".c").read_text(encoding="utf-8"))
    if kernel is None:
        return None
    terms, integer, array = ctypes.c_void_p, ctypes.c_int64, ArrayPointer
    kernel.deatwin_run.restype = integer
    kernel.deatwin_run.argtypes = (terms, integer, *(array,) * 7)
    kernel.deatwin_errors.restype = None
    kernel.deatwin_errors.argtypes = (terms, integer, integer, array, array, integer, *(array,) * 8)
    return kernel


def require_steps(steps: int, first: int, n_samples: int) -> None:
    """Raise ModelError unless a recording has room for a prediction `steps` samples ahead from sample `first` on."""
    if whole_number(steps, "steps") > n_samples - first:
        raise ModelError(f"steps = {steps}; the recording of {n_samples} samples allows at most {n_samples - first}")


def steps_ahead(
    table: TermTable, theta: Array, inputs: Array, outputs: Array, steps: int, limit: float, equations: Sequence[int]
) -> tuple[Array, Booleans]:
    """Predict from outputs up to ``steps`` before; return (n_outputs, m) of the m last samples, divergences (m,)."""
    belongs = np.array(equations)

    weights = np.where(belongs == np.arange(len(outputs))[:, None], theta, 0.0)
    signals = {"u": inputs, "y": outputs}
    if table.channels("e"):
        signals["e"] = innovations(table, theta, inputs, outputs, equations)
    n = outputs.shape[1] - table.max_lag - steps + 1
    found, failed = np.empty((len(outputs), n)), np.zeros(n, dtype=np.bool_)
    for start in range(0, n, _HORIZONS):
        part = slice(start, min(start + _HORIZONS, n))
        found[:, part], failed[part] = _from_each(table, weights, signals, steps, limit, part)
    return found, failed


def _from_each(
    table: TermTable, weights: Array, signals: dict[str, Array], steps: int, limit: float, part: slice
) -> tuple[Array, Booleans]:
    """Simulate the runs whose first computed samples are ``max_lag`` + those of ``part``; return their last outputs."""
    first, last = table.max_lag + part.start, table.max_lag + part.stop
    state = signals["y"][:, max(first - 1, 0) : max(last - 1, 0)] if first else np.zeros((len(weights), last))
    lost = np.zeros(last - first, dtype=np.bool_)
    past: list[Array] = []
    for step in range(steps):

        def lagged(v: Variable, lag: int, step: int = step, past: list[Array] = past) -> Array:
            if v.kind == "u" or lag > step:
                return signals[v.kind][v.index, first + step - lag : last + step - lag]
            return past[-lag][v.index] if v.kind == "y" else np.zeros(last - first)

        with np.errstate(over="ignore", invalid="ignore"):  # detected in the next line
            values = weights @ table.over(table.of_signals(lagged), last - first)
        lost |= ~np.all(np.abs(values) < limit, axis=0)
        state = np.where(lost, state, values)
        past = [*past, state][-max(table.max_lag, 1) :]
    return state, lost
