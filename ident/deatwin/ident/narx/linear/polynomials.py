"""The polynomials of a linear model, A y = sum_i (B_i/F_i) u_i + (C/D) e + offset, and their orders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Variables
from deatwin.plant.errors import ModelError

ONE = np.ones(1)
ONE.setflags(write=False)
_LARGEST = 0.9999  # magnitude up to which a root counts as inside the unit circle when a search starts


class Polynomials(NamedTuple):
    """Polynomials of a `LinearModel`, A y = sum_i (B_i/F_i) u_i + (C/D) e + offset, as arrays of coefficients.

    The coefficients belong to the powers q^0, q^-1, ... of the backward shift.

    Parameters
    ----------
    a, c, d : ndarray, shape (order + 1,)
        Coefficients of A, C and D; the first is 1.
    b : tuple of ndarray
        Coefficients of B_i for each input; one leading zero for each sample of delay.
    f : tuple of ndarray
        Coefficients of F_i for each input; the first is 1.
    offset : float
        Constant on the right side of the equation, in the output's unit.
    """

    a: Array
    b: tuple[Array, ...]
    c: Array
    d: Array
    f: tuple[Array, ...]
    offset: float

    def require(self) -> None:
        """Raise ModelError unless A, C, D and all F_i begin with 1, no B_i is zero, and all coefficients are finite."""
        monic = {"a": self.a, "c": self.c, "d": self.d} | {f"f[{i}]": f for i, f in enumerate(self.f)}
        for name, polynomial in monic.items():
            if polynomial.ndim != 1 or polynomial.size == 0 or polynomial[0] != 1.0:
                raise ModelError(f"the polynomial {name} = {polynomial} must begin with 1")
        for i, b in enumerate(self.b):
            if b.ndim != 1 or not np.any(b):
                raise ModelError(f"the polynomial b[{i}] = {b} needs a coefficient that is not zero")
        if not all(np.all(np.isfinite(p)) for p in (*monic.values(), *self.b, np.array(self.offset))):
            raise ModelError("all coefficients must be finite")

    @property
    def longest(self) -> int:
        """Number of coefficients of the longest polynomial."""
        return max(p.size for p in (self.a, self.c, self.d, *self.b, *self.f))

    def by_power(self) -> Variables:
        """Return all polynomials as arrays of the same length, padded with zeros."""

        def whole(polynomial: Array) -> Array:
            return np.pad(polynomial, (0, self.longest - polynomial.size))

        return {
            **{name: ("power", whole(getattr(self, name))) for name in ("a", "c", "d")},
            **{name: (("input", "power"), np.array([whole(p) for p in getattr(self, name)])) for name in ("b", "f")},
        }


@dataclass(frozen=True, kw_only=True)
class Orders:
    """Orders and delays of a `LinearModel`, A y = sum_i (B_i/F_i) u_i + (C/D) e + offset.

    The parameter vector of the model contains the free coefficients of A, of all B_i, of all F_i, of C and of D, and
    then the offset.

    Parameters
    ----------
    na, nc, nd : int
        Orders of A, C and D.
    nb, nf, nk : tuple of int
        For each input, the number of coefficients of B_i, the order of F_i, and the delay in samples.
    offset : bool
        True if the offset is a free parameter.
    """

    na: int
    nb: tuple[int, ...]
    nc: int
    nd: int
    nf: tuple[int, ...]
    nk: tuple[int, ...]
    offset: bool

    @classmethod
    def of(cls, polynomials: Polynomials) -> Orders:
        """Return the orders of `polynomials`. Leading zeros of B_i are its delay; no B_i may be zero."""
        delays = tuple(int(np.flatnonzero(b)[0]) for b in polynomials.b)
        return cls(
            na=polynomials.a.size - 1,
            nb=tuple(b.size - nk for b, nk in zip(polynomials.b, delays, strict=True)),
            nc=polynomials.c.size - 1,
            nd=polynomials.d.size - 1,
            nf=tuple(f.size - 1 for f in polynomials.f),
            nk=delays,
            offset=True,
        )

    @property
    def input_lag(self) -> int:
        """Largest lag of an input."""
        return max((nk + nb - 1 for nk, nb in zip(self.nk, self.nb, strict=True)), default=0)

    @property
    def first(self) -> int:
        """Index of the first sample whose lagged outputs and inputs are all measured."""
        return max(self.na, self.input_lag)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of parameters of A, of each B_i, of each F_i, of C, of D, and of the offset."""
        return (self.na, *self.nb, *self.nf, self.nc, self.nd, int(self.offset))

    @property
    def n_theta(self) -> int:
        """Number of parameters."""
        return sum(self.sizes)

    def split(self, theta: Array) -> Polynomials:
        """Return the polynomials that a parameter vector `theta` (n_theta,) describes."""
        ends = list(accumulate(self.sizes))
        a, *rest = (theta[end - size : end] for end, size in zip(ends, self.sizes, strict=True))
        m = len(self.nb)
        c, d, offset = rest[2 * m :]
        return Polynomials(
            a=np.concatenate((ONE, a)),
            b=tuple(np.concatenate((np.zeros(nk), b)) for nk, b in zip(self.nk, rest[:m], strict=True)),
            c=np.concatenate((ONE, c)),
            d=np.concatenate((ONE, d)),
            f=tuple(np.concatenate((ONE, f)) for f in rest[m : 2 * m]),
            offset=float(offset[0]) if self.offset else 0.0,
        )

    def join(self, polynomials: Polynomials) -> Array:
        """Return the parameter vector (n_theta,) of `polynomials` of these orders."""
        p = polynomials
        b = [b[nk:] for b, nk in zip(p.b, self.nk, strict=True)]
        tail = [p.offset] if self.offset else []
        return np.concatenate([p.a[1:], *b, *(f[1:] for f in p.f), p.c[1:], p.d[1:], tail])

    def scales(self, input_scales: Array, output_scale: float) -> Array:
        """Return factors (n_theta,) that convert parameters to physical units, if signals were divided by `input_scales`,
        shape (n_inputs,), and by `output_scale`."""
        gains = [np.full(nb, output_scale / scale) for nb, scale in zip(self.nb, input_scales, strict=True)]
        ones = np.ones(sum(self.nf) + self.nc + self.nd)
        tail = [output_scale] if self.offset else []
        return np.concatenate([np.ones(self.na), *gains, ones, tail])


def per_input(name: str, value: int | Sequence[int], n_inputs: int, least: int) -> tuple[int, ...]:
    """Return an order for each input; a single number holds for all."""
    values = tuple(value) if isinstance(value, Sequence | np.ndarray) else (value,) * n_inputs
    if len(values) != n_inputs or any(not isinstance(v, int | np.integer) or v < least for v in values):
        raise ModelError(
            f"{name} = {value!r}; give an integer of at least {least}, or one for each of {n_inputs} input(s)"
        )
    return tuple(int(v) for v in values)


def is_stable(polynomial: Array) -> bool:
    """Return True if all roots of a polynomial in q^-1, (order + 1,), lie inside the unit circle."""
    return polynomial.size == 1 or bool(np.abs(np.roots(polynomial)).max() < 1.0)


def reflected(polynomial: Array) -> Array:
    """Return a polynomial (order + 1,) with its roots reflected into the unit circle, as a starting point of a search."""
    if polynomial.size == 1:
        return polynomial
    roots = np.roots(polynomial)
    size = np.abs(roots)
    inside = np.minimum(np.where(size > 1.0, 1.0 / np.maximum(size, 1.0), size), _LARGEST)
    roots = np.where(size > 0.0, roots / np.where(size > 0.0, size, 1.0) * inside, roots)
    return np.asarray(np.poly(roots).real, dtype=np.float64)
