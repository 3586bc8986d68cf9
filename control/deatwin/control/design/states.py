"""A linear model in state-space form, for designs that need states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.control.controllers.law import Law
from deatwin.control.linear.model import LinearModel
from deatwin.plant.arrays import Array

_NO_ANSWER = 1e-7
"""Share of the static gain below which a response counts as none: ten times the error of `States.balanced`."""
_HARDLY = 5e-9
"""Hankel singular value, relative to the largest, below which a state is left out; the error is twice the sum of those
left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """State-space model ``x(k+1) = A x(k) + B u(k)``, ``y(k) = gain C x(k)``, whose static gain from B to C is one."""

    a: Array  # shape (n, n): A
    b: Array  # shape (n,): B; the states are in the input's unit
    c: Array  # shape (n,): C
    gain: float  # Static gain, output unit per input unit

    @classmethod
    def of(cls, linear: LinearModel) -> States:
        """Return states of a model: its own matrices, or the observable canonical form of its coefficients."""
        gain = linear.require_in_loop().static_gain
        if linear.realisation is not None:
            a, b, c, _ = linear.realisation.joined()
            return cls(a=a, b=b, c=c / gain, gain=gain)
        top, bottom = (np.trim_zeros(p, "b") for p in (linear.numerator / gain, linear.denominator))
        n = max(top.size, bottom.size) - 1
        top, bottom = (np.pad(p, (0, n + 1 - p.size)) for p in (top, bottom))
        a = np.eye(n, k=1)
        a[:, 0] = -bottom[1:]
        return cls(a=a, b=top[1:], c=np.eye(1, n)[0], gain=gain)

    @property
    def rest(self) -> Array:
        """States at rest under a constant unit input, shape (n,)."""
        return np.asarray(np.linalg.solve(np.eye(self.b.size) - self.a, self.b))

    def balanced(self) -> States:
        """Return a balanced realisation without nearly hidden states (Laub et al., IEEE TAC 32 (1987))."""
        from scipy.linalg import solve_discrete_lyapunov

        a, b, c = self.a, self.b, self.c
        for _ in range(2):  # the second round restores digits that the companion matrix lost
            reached, seen = (_root(solve_discrete_lyapunov(m, np.outer(v, v))) for m, v in ((a, b), (a.T, c)))
            left, sizes, right = np.linalg.svd(seen.T @ reached)
            kept = sizes > _HARDLY * sizes[0]
            into = reached @ right[kept].T / np.sqrt(sizes[kept])
            back = (seen @ left[:, kept] / np.sqrt(sizes[kept])).T
            a, b, c = back @ a @ into, back @ b, c @ into
        return States(a=a, b=b, c=c, gain=self.gain)

    @property
    def delay(self) -> int:
        """Number of samples from a command to the first reading that responds to it, at least 1."""
        moved, samples = self.b, 1
        while abs(self.c @ moved) <= _NO_ANSWER and samples <= self.b.size:
            moved, samples = self.a @ moved, samples + 1
        return samples


def _root(gramian: Array) -> Array:
    """Return a factor F with F F' = W, for a matrix W that is positive semidefinite up to rounding."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(values.clip(min=0.0)))


def integrating(law: Law) -> Law:
    """Return a law whose pole nearest to z = 1 is moved exactly there."""
    values, right = np.linalg.eig(law.a)
    nearest = int(np.argmin(np.abs(values - 1.0)))
    left = np.linalg.inv(right)[nearest].real
    moved = law.a + (1.0 - values[nearest].real) * np.outer(right[:, nearest].real, left)
    return Law(a=moved, b=law.b, c=law.c, d=law.d)
