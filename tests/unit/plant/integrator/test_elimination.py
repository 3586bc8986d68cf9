"""Linear systems solved on symbols."""

import casadi as ca
import numpy as np
import pytest

from deatwin.plant.integrator.elimination import Complex, factorised, products


def symbols(name, mask):
    """A matrix of complex symbols where the mask is not zero."""
    parts = [ca.SX.sym(f"{name}_{part}", *mask.shape) for part in ("re", "im")]
    rows = [
        [Complex(*(p[i, j] for p in parts)) if mask[i, j] else Complex(ca.SX(0)) for j in range(mask.shape[1])]
        for i in range(mask.shape[0])
    ]
    return parts, rows


@pytest.mark.parametrize("seed", range(5))
def test_a_sparse_complex_system_is_solved(seed):
    rng = np.random.default_rng(seed)
    n = 6
    mask = (rng.random((n, n)) < 0.4) | np.eye(n, dtype=bool)
    # Dominant diagonals: safe without pivoting on values, condition number below ten.
    matrix = mask * (rng.uniform(-1, 1, (n, n)) + 1j * rng.uniform(-1, 1, (n, n))) + 10 * np.eye(n)
    right = rng.uniform(-1, 1, n) + 1j * rng.uniform(-1, 1, n)
    parts, rows = symbols("a", mask)
    sides, column = symbols("b", np.ones((n, 1), dtype=bool))
    found = factorised(rows).solve([row[0] for row in column])
    solve = ca.Function(
        "solve", [*parts, *sides], [ca.vertcat(*(v.real for v in found)), ca.vertcat(*(v.imaginary for v in found))]
    )
    re, im = (np.asarray(v).ravel() for v in solve(matrix.real, matrix.imag, right.real, right.imag))
    np.testing.assert_allclose(re + 1j * im, np.linalg.solve(matrix, right), rtol=0, atol=1e-14)


def test_an_arrow_fills_nothing():
    # Last row and column full: eliminated in the given order reversed it would fill 8 x 8.
    n = 8
    mask = np.eye(n, dtype=bool)
    mask[0], mask[:, 0] = True, True
    factors = factorised(symbols("a", mask)[1])
    assert 0 in factors.columns[-2:]
    assert sum(not entry.is_zero for row in factors.entries for entry in row) == 3 * n - 2


def test_products_are_those_of_the_best_order():
    # Entries of the row of each pivot times those of its column: two by two in an arrow, the sum of squares if full.
    n = 8
    arrow = [set(range(n)), *({0, i} for i in range(1, n))]
    assert products(arrow) == 4 * (n - 1) + 1
    assert products([set(range(n))] * n) == sum(k**2 for k in range(1, n + 1))


def test_equations_may_come_in_another_order_than_unknowns():
    order = [2, 0, 3, 1]  # no entry on the diagonal
    mask = np.eye(4, dtype=bool)[order]
    mask[0, 3] = True
    matrix = mask * np.array([[2.0], [3.0], [5.0], [7.0]])
    (re, im), rows = symbols("a", mask)
    one = Complex(ca.SX(1.0))
    found = factorised(rows).solve([one] * 4)
    solve = ca.Function("solve", [re, im], [ca.vertcat(*(v.real for v in found))])
    np.testing.assert_allclose(np.asarray(solve(matrix, 0)).ravel(), np.linalg.solve(matrix, np.ones(4)), rtol=1e-14)


def test_a_zero_pivot_is_not_hidden():
    zero, one = Complex(ca.SX.sym("z")), Complex(ca.SX(1.0))
    found = factorised([[zero, one], [one, zero]]).solve([one, one])
    value = ca.Function("f", [zero.real], [found[0].real])(0.0)
    assert not np.isfinite(float(value))
