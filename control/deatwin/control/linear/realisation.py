"""A sampled linear system by its matrices, and the coefficients of its transfer function.

A polynomial loses the digits of slow poles, which crowd near z = 1, so gain, poles, zeros and responses come from the
matrices. Coefficients come from a minimal realisation, by the recursion of Faddeev and Leverrier in integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import Array, Complex

_NOTHING = 1e-11
"""Cosine between a mode and the inputs that excite it, or the output that shows it, below which it counts as rounding.
One sample of the slowest effect of the catalogue, 20000 s, still moves its mode by 1e-6."""
_BLOCK = 512  # Number of samples of a step response that are computed at once
_BITS = 64
"""Number of bits of a matrix's largest entry in integers. Smaller entries keep all that a sum with the largest one
would keep, and 11 bits more."""
_LOWEST, _POINTS = 1e-3, 50
"""Lowest frequency, Hz, and number of frequencies at which coefficients are compared with the matrices."""
_LOSS = 1e-6  # Relative error of the response by the coefficients above which a remark is made


@dataclass(frozen=True, kw_only=True, eq=False)
class Realisation:
    """State space with input lags: ``x(k+1) = A x(k) + sum_l B_l u(k-l)``, ``y(k) = C x(k) + sum_l D_l u(k-l)``."""

    a: Array  # shape (n, n): A, for states of similar size
    b: Array  # shape (n, n_lags): B, one column per lag of the input, per unit of the input
    c: Array  # shape (n,): C, in the output's unit
    d: Array  # shape (n_lags,): D, output unit per input unit

    @cached_property
    def modes(self) -> Complex:
        """Eigenvalues of A, shape (n,)."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)

    @cached_property
    def static_gain(self) -> float:
        """Return C (I - A)^-1 B + D, output unit per input unit; infinite if a mode integrates."""
        try:
            return float(self.c @ self._rest(self.b.sum(axis=1)) + self.d.sum())
        except np.linalg.LinAlgError:
            return float("inf")

    @property
    def mean_delay(self) -> float:
        """Return the mean time of the impulse response, in samples: the sum of lags and delays minus the leads."""
        lags, rest = np.arange(self.d.size), self._rest(self.b.sum(axis=1))
        late = self.c @ (self._rest(rest) + self._rest(self.b @ lags)) + self.d @ lags
        return float(late / self.static_gain)

    @property
    def zeros(self) -> Complex:
        """Return the finite zeros in the z plane, shape (n_zeros,)."""
        from scipy.linalg import eigvals

        a, b, c, d = self.joined()
        moved, seen = np.linalg.norm(b), np.linalg.norm(c)
        pencil = np.block([[a, b[:, None] / moved], [c[None, :] / seen, np.full((1, 1), d / (moved * seen))]])
        above, below = eigvals(pencil, np.diag([*np.ones(b.size), 0.0]), homogeneous_eigvals=True)
        finite = np.abs(below) > 1e-12 * np.abs(above)
        return np.asarray(above[finite] / below[finite], dtype=np.complex128)

    def _rest(self, pushed: Array) -> Array:
        return np.asarray(np.linalg.solve(np.eye(len(self.a)) - self.a, pushed))

    def joined(self) -> tuple[Array, Array, Array, float]:
        """Return A, B, C and D of the system whose states include the past inputs."""
        n, late = len(self.a), self.d.size - 1
        a, b = np.zeros((n + late, n + late)), np.zeros(n + late)
        a[:n, :n], a[:n, n:], b[:n] = self.a, self.b[:, 1:], self.b[:, 0]
        if late:
            b[n] = 1.0
            a[n + 1 :, n:-1] = np.eye(late - 1)
        return a, b, np.concatenate([self.c, self.d[1:]]), float(self.d[0])

    def delayed(self) -> Realisation:
        """Delay the input by one sample."""
        return Realisation(a=self.a, b=np.pad(self.b, ((0, 0), (1, 0))), c=self.c, d=np.concatenate([[0.0], self.d]))

    def scaled(self, factor: float) -> Realisation:
        """Multiply the output by a factor, which may have a unit."""
        return Realisation(a=self.a, b=self.b, c=factor * self.c, d=factor * self.d)

    def step_response(self, count: int) -> Array:
        """Response to a unit step of the input. `count` number of samples; returns (count,)."""
        a, b, c, d = self.joined()
        # The input becomes a constant state, so that many samples follow from one by powers of a matrix.
        whole = np.block([[a, b[:, None]], [np.zeros((1, b.size)), np.ones((1, 1))]])
        rows = [np.append(c, d)]
        for _ in range(min(count, _BLOCK) - 1):
            rows.append(rows[-1] @ whole)
        seen, jump = np.array(rows), np.linalg.matrix_power(whole, _BLOCK)
        state, parts = np.append(np.zeros(b.size), 1.0), []
        for _ in range(0, count, _BLOCK):
            parts.append(seen @ state)
            state = jump @ state
        return np.concatenate(parts)[:count] if parts else np.zeros(0)

    @cached_property
    def _triangular(self) -> tuple[Complex, Complex, Complex]:
        """Return A as an upper triangle after a unitary change of states, which loses no digits, with B and C."""
        from scipy.linalg import schur

        upper, turn = schur(self.a, output="complex")
        return upper, turn.conj().T @ self.b, self.c @ turn

    def response(self, delay: Complex) -> Complex:
        """Return the transfer function, from the matrices. Shapes: `delay` (n_points,); returns (n_points,)."""
        lags = delay[:, None] ** np.arange(self.d.size)
        found = lags @ self.d
        if not self.c.size:
            return np.asarray(found, dtype=np.complex128)
        upper, b, c = self._triangular
        states = b @ lags.T
        for i in range(c.size - 1, -1, -1):
            states[i] = (states[i] + upper[i, i + 1 :] @ states[i + 1 :]) / (1.0 / delay - upper[i, i])
        return np.asarray(c @ states + found, dtype=np.complex128)

    def remark_on(self, numerator: Array, denominator: Array, sample_time: float, whose: str) -> str:
        """Return a remark on the digits that coefficients of this system lost by rounding; empty if they are few."""
        omega = np.geomspace(min(2 * np.pi * _LOWEST, 0.1 * np.pi / sample_time), np.pi / sample_time, _POINTS)
        delay = np.exp(-1j * omega * sample_time)
        exact = self.response(delay)
        held = np.polyval(numerator[::-1], delay) / np.polyval(denominator[::-1], delay)
        size = float(np.abs(exact).max(initial=0.0))
        loss = float(np.max(np.abs(held - exact) / np.maximum(np.abs(exact), 1e-9 * size))) if size else 0.0
        if loss <= _LOSS:
            return ""
        share = f"only to {loss:.1g} of it" if loss < 1.0 else "not at all"
        return f"{whose} has many slow modes, so that the coefficients hold its response {share}; its matrices do"

    def minimal(self) -> Realisation:
        """Return a minimal realisation: without modes that are uncontrollable or unobservable."""
        found = self
        while found.a.size:
            hidden = _hidden(found.a, found.b)
            if hidden is not None:  # w'x stays zero, so that x lies in the complement of w
                kept = _complement(hidden)
            else:
                hidden = _hidden(found.a.T, found.c[:, None])
                if hidden is None:
                    break
                kept = _complement(hidden)  # the part of x along v does not show, so that it can be left out
            found = Realisation(a=kept.T @ found.a @ kept, b=kept.T @ found.b, c=found.c @ kept, d=found.d)
        return found

    def coefficients(self) -> tuple[Array, Array]:
        """Return numerator (n + n_lags,) and denominator (n + 1,) in powers of z^-1, exact but for one rounding."""
        n, n_lags = self.b.shape
        (a, unit_a), (b, unit_b), (c, unit_c), (d, unit_d) = (_integers(m) for m in (self.a, self.b, self.c, self.d))
        identity = np.array([[int(i == j) for j in range(n)] for i in range(n)], dtype=object).reshape(n, n)
        adjoint, bottom = identity, [1]  # Coefficients of z I - A, from the highest power of z on
        top = [[Fraction(0)] * n_lags]
        for order in range(1, n + 1):
            # C M_k B is in units of C times B times A to the power k - 1.
            unit = unit_c * unit_b * unit_a ** (order - 1)
            top.append([Fraction(int(value)) * unit for value in c @ adjoint @ b])
            adjoint = a @ adjoint
            bottom.append(-int(np.trace(adjoint)) // order)  # exact: an integer matrix has integer coefficients
            adjoint = adjoint + bottom[-1] * identity
        powers = [Fraction(value) * unit_a**order for order, value in enumerate(bottom)]
        numerator = [Fraction(0)] * (n + n_lags)
        for lag in range(n_lags):
            through = Fraction(int(d[lag])) * unit_d
            for order in range(n + 1):
                numerator[order + lag] += top[order][lag] + through * powers[order]
        return np.array([float(v) for v in numerator]), np.array([float(v) for v in powers])


def _integers(matrix: Array) -> tuple[NDArray[Any], Fraction]:
    """Write a matrix as integer multiples of a power of two; return the integers and this power."""
    largest = float(np.abs(matrix).max(initial=0.0))
    unit = Fraction(2) ** (int(np.frexp(largest)[1]) - _BITS)
    whole = [round(Fraction(float(value)) / unit) for value in matrix.ravel()]
    return np.array(whole, dtype=object).reshape(matrix.shape), unit


def _hidden(a: Array, b: Array) -> Array | None:
    """Return a basis, of one or two columns, of a left eigenvector that b does not excite; None if there is none."""
    values, vectors = np.linalg.eig(a.T)
    size = float(np.linalg.norm(b))
    excited = np.abs(vectors.T @ b).max(axis=1, initial=0.0) / (size if size > 0.0 else 1.0)
    least = int(np.argmin(excited))
    if excited[least] > _NOTHING:
        return None
    vector = vectors[:, least]
    parts = vector.real[:, None] if values[least].imag == 0.0 else np.column_stack([vector.real, vector.imag])
    return np.asarray(parts, dtype=np.float64)


def _complement(basis: Array) -> Array:
    """Return an orthonormal basis of the space orthogonal to some columns."""
    return np.asarray(np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :])
