"""From the matrices of a sampled linear system to the coefficients of its transfer function, without loss.

Slow poles crowd near z = 1: of a product of factors 1 - p, each some 1e-4, the coefficients of the polynomial hold no
more than their last digits. So modes that nothing excites or shows are taken out first, and the coefficients are then
computed in integers, by the recursion of Faddeev and Leverrier, and rounded once.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Realisation"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_NOTHING = 1e-11
"""Cosine of a mode with all that excites it, or shows it, below which that is rounding: one sample of the slowest
effect of the catalogue, 20000 s, still moves its mode by 1e-6."""
_BITS = 64
"""Behind the point of the largest entry of a matrix in integers; smaller entries lose nothing that a sum with the
largest would keep, and 11 bits more than that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Realisation:
    """``x(k+1) = A x(k) + sum_l B_l u(k-l)``, ``y(k) = C x(k) + sum_l D_l u(k-l)``.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        Of the states, which are of like size.
    b : ndarray, shape (n, n_lags)
        A column for each lag of the input, by unit of the input.
    c : ndarray, shape (n,)
        Output unit.
    d : ndarray, shape (n_lags,)
        Output unit by input unit.
    """

    a: Array
    b: Array
    c: Array
    d: Array

    @cached_property
    def modes(self) -> Complex:
        """Eigenvalues of A, shape (n,)."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)

    def response(self, delay: Complex) -> Complex:
        """The transfer function from the matrices themselves.

        Parameters
        ----------
        delay : ndarray of complex, shape (n_points,)
            ``1/z``.

        Returns
        -------
        ndarray of complex, shape (n_points,)
            Output unit by input unit.
        """
        lags = delay[:, None] ** np.arange(self.d.size)
        shifted = np.eye(len(self.a)) / delay[:, None, None] - self.a
        states = np.linalg.solve(shifted, (lags @ self.b.T)[:, :, None].astype(complex))[:, :, 0]
        return np.asarray(states @ self.c + lags @ self.d)

    def minimal(self) -> Realisation:
        """The same system without modes that the input does not excite or the output does not show.

        Returns
        -------
        Realisation
            Of as many states or fewer; the memory of hysteresis at rest, for instance, only adds to the stiffness.
        """
        found = self
        while found.a.size:
            hidden = _hidden(found.a, found.b)
            if hidden is not None:  # w'x stays zero: the rest lies in the complement of w
                kept = _complement(hidden)
            else:
                hidden = _hidden(found.a.T, found.c[:, None])
                if hidden is None:
                    break
                kept = _complement(hidden)  # along v nothing is seen, so that x may be taken without it
            found = Realisation(a=kept.T @ found.a @ kept, b=kept.T @ found.b, c=found.c @ kept, d=found.d)
        return found

    def coefficients(self) -> tuple[Array, Array]:
        """Numerator and denominator in powers of z^-1, exact but for one rounding.

        Returns
        -------
        numerator : ndarray, shape (n + n_lags,)
            b_0, b_1, ..., output unit by input unit.
        denominator : ndarray, shape (n + 1,)
            1, a_1, ..., a_n.
        """
        n, n_lags = self.b.shape
        (a, unit_a), (b, unit_b), (c, unit_c), (d, unit_d) = (_integers(m) for m in (self.a, self.b, self.c, self.d))
        identity = np.array([[int(i == j) for j in range(n)] for i in range(n)], dtype=object).reshape(n, n)
        adjoint, bottom = identity, [1]  # of z I - A, from the highest power of z on
        top = [[Fraction(0)] * n_lags]
        for order in range(1, n + 1):
            # C M_k B counts in units of C and B, and of A to the power k - 1.
            unit = unit_c * unit_b * unit_a ** (order - 1)
            top.append([Fraction(int(value)) * unit for value in c @ adjoint @ b])
            adjoint = a @ adjoint
            bottom.append(-int(np.trace(adjoint)) // order)  # coefficients of an integer matrix are integers
            adjoint = adjoint + bottom[-1] * identity
        powers = [Fraction(value) * unit_a**order for order, value in enumerate(bottom)]
        numerator = [Fraction(0)] * (n + n_lags)
        for lag in range(n_lags):
            through = Fraction(int(d[lag])) * unit_d
            for order in range(n + 1):
                numerator[order + lag] += top[order][lag] + through * powers[order]
        return np.array([float(v) for v in numerator]), np.array([float(v) for v in powers])


def _integers(matrix: Array) -> tuple[NDArray[Any], Fraction]:
    """A matrix in whole multiples of a power of two, and that power."""
    largest = float(np.abs(matrix).max(initial=0.0))
    unit = Fraction(2) ** (int(np.frexp(largest)[1]) - _BITS)
    whole = [round(Fraction(float(value)) / unit) for value in matrix.ravel()]
    return np.array(whole, dtype=object).reshape(matrix.shape), unit


def _hidden(a: Array, b: Array) -> Array | None:
    """A left eigenvector that no column of b excites, as an orthonormal basis of one or two columns; None without."""
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
    """Orthonormal basis of what is orthogonal to some columns."""
    return np.asarray(np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :])
