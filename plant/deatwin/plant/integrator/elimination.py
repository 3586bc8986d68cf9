"""Small linear systems solved on symbols: real or complex, sparse, straight-line code without loops.

Pivots are not chosen by value: the caller must notice a result that is not finite.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

Symbol = Any


@dataclass(frozen=True)
class Complex:
    """A complex number whose parts are symbols; parts that are always zero are omitted."""

    real: Symbol  # Scalars
    imaginary: Symbol = field(default_factory=lambda: ca.SX(0))

    @property
    def is_zero(self) -> bool:
        """True if both parts are always zero."""
        return bool(self.real.is_zero() and self.imaginary.is_zero())

    def __sub__(self, other: Complex) -> Complex:
        return Complex(self.real - other.real, self.imaginary - other.imaginary)

    def __mul__(self, other: Complex) -> Complex:
        return Complex(
            self.real * other.real - self.imaginary * other.imaginary,
            self.real * other.imaginary + self.imaginary * other.real,
        )

    def reciprocal(self) -> Complex:
        """One over the number."""
        if self.imaginary.is_zero():
            return Complex(1 / self.real)
        scale = 1 / (self.real**2 + self.imaginary**2)
        return Complex(self.real * scale, -self.imaginary * scale)


Rows = Sequence[Sequence[Complex]]


@dataclass(frozen=True, kw_only=True)
class Factors:
    """Lower and upper factor of a matrix in one array, with the reciprocals of the pivots on the diagonal."""

    entries: Rows  # n rows of n, in the order of elimination
    rows: Sequence[int]  # Row of each pivot in the matrix, in the order of elimination
    columns: Sequence[int]  # Column of each pivot in the matrix

    def renamed(self, symbols: Iterator[Symbol]) -> Factors:
        """Return the pattern with a new symbol for each part that may be nonzero."""

        def named(part: Symbol) -> Symbol:
            return part if part.is_zero() else next(symbols)

        entries = [[Complex(named(e.real), named(e.imaginary)) for e in row] for row in self.entries]
        return Factors(entries=entries, rows=self.rows, columns=self.columns)

    def solve(self, right: Sequence[Complex]) -> list[Complex]:
        """Solve for one right-hand side."""
        found = [right[i] for i in self.rows]
        for i, row in enumerate(self.entries):
            for j in range(i):
                found[i] = _less(found[i], row[j], found[j])
        for i in reversed(range(len(found))):
            for j in range(i + 1, len(found)):
                found[i] = _less(found[i], self.entries[i][j], found[j])
            found[i] = found[i] * self.entries[i][i]
        return [value for _, value in sorted(zip(self.columns, found, strict=True), key=lambda pair: pair[0])]


def factorised(matrix: Rows) -> Factors:
    """Factorise a matrix by elimination."""
    pattern = [{j for j, entry in enumerate(row) if not entry.is_zero} for row in matrix]
    partner = _partners(pattern)
    columns = _ordered([pattern[partner[j]] for j in range(len(pattern))])[0]
    rows = [partner[j] for j in columns]
    a = [[matrix[i][j] for j in columns] for i in rows]
    for k, pivot_row in enumerate(a):
        pivot_row[k] = pivot_row[k].reciprocal()
        for row in a[k + 1 :]:
            row[k] = row[k] * pivot_row[k]
            for j in range(k + 1, len(a)):
                row[j] = _less(row[j], row[k], pivot_row[j])
    return Factors(entries=a, rows=rows, columns=columns)


def _less(value: Complex, left: Complex, right: Complex) -> Complex:
    """Return ``value - left * right``, omitting absent parts."""
    return value if left.is_zero or right.is_zero else value - left * right


def _partners(pattern: Sequence[set[int]]) -> list[int]:
    """Return, for each column, a row that has an entry there; each row is used once, if possible for its own column."""
    n = len(pattern)
    if all(i in row for i, row in enumerate(pattern)):
        return list(range(n))
    pairs = [(i, j) for i, row in enumerate(pattern) for j in sorted(row)]
    _, rows, columns, *_ = ca.Sparsity.triplet(n, n, [i for i, _ in pairs], [j for _, j in pairs]).btf()
    return [row for _, row in sorted(zip(columns, rows, strict=True))]


def products(pattern: Sequence[set[int]]) -> int:
    """Return the number of products in the elimination of a matrix, given the columns of the entries in each row."""
    partner = _partners(pattern)
    return _ordered([pattern[partner[j]] for j in range(len(pattern))])[1]


def _ordered(pattern: Sequence[set[int]]) -> tuple[list[int], int]:
    """Order diagonal pivots by Markowitz' count of products; return the order and the sum of the counts."""
    rows, left, order, total = [set(row) for row in pattern], set(range(len(pattern))), [], 0

    def cost(pivot: int) -> tuple[int, int]:
        return len(rows[pivot] & left) * sum(pivot in rows[i] for i in left), pivot

    while left:
        count, pivot = min(map(cost, left))
        total += count
        order.append(pivot)
        left.remove(pivot)
        for i in left:
            if pivot in rows[i]:
                rows[i] |= rows[pivot]
    return order, total
