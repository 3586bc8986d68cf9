"""C code for several points, and for several right sides, at once."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from deatwin.plant.integrator import dense, lanes
from deatwin.plant.integrator.collocation import radau, step_functions

COUNT = 5
CALL = "int f(const double** arg, double** res, long long* iw, double* w, int mem)"


def ordinary(x, y):
    """One of each operation that equations use."""
    positive = ca.sqrt(x**2 + 1)
    return ca.vertcat(
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        x**2,
        2 * x,
        1 / y,
        positive,
        ca.exp(x),
        ca.log(positive),
        positive**y,
        positive**2.5,
        ca.sin(x),
        ca.cos(x),
        ca.tan(x),
        ca.asin(ca.tanh(x)),
        ca.acos(ca.tanh(x)),
        ca.atan(x),
        ca.atan2(x, y),
        ca.sinh(x),
        ca.cosh(x),
        ca.tanh(x),
        ca.asinh(x),
        ca.acosh(positive),
        ca.atanh(ca.tanh(x)),
        ca.log1p(positive),
        ca.expm1(x),
        ca.hypot(x, y),
        ca.erf(x),
        ca.floor(x),
        ca.ceil(x),
        ca.fabs(x),
        ca.fmin(x, y),
        ca.fmax(x, y),
        ca.sign(x),
        ca.if_else(x < y, x, y),
        ca.if_else(x <= y, 1, 2),
        ca.if_else(x == y, 1, 2),
        ca.if_else(x != y, 1, 2),
        ca.logic_and(x, y),
        ca.logic_or(x, y),
        ca.logic_not(x),
        0.1,
    )


def test_every_operation_gives_what_casadi_gives(c_compiler, tmp_path):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ordinary(x, y)])
    helper = lanes.in_lanes(function, varying=[0])
    points, other = np.array([-1.3, -0.4, 0.0, 0.7, 2.1]), np.array([0.7])
    for count in (1, COUNT):
        result = np.zeros((count, function.nnz_out(0)))
        called(c_compiler, tmp_path / str(count), lanes.call_in_lanes(function, count), helper)([points, other], result)
        expected = np.hstack([np.asarray(function(p, 0.7)) for p in points[:count]]).T
        np.testing.assert_allclose(result, expected, rtol=4e-16, atol=1e-300)


def test_a_result_that_nobody_wants_is_not_written(c_compiler, tmp_path):
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [x + 1, 2 * x])
    call = called(c_compiler, tmp_path, lanes.call_in_lanes(function, 2), lanes.in_lanes(function, varying=[0]))
    result = np.zeros(2)
    call([np.array([3.0, 5.0])], None, result)
    np.testing.assert_array_equal(result, [6.0, 10.0])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("n", "n_x", "columns"), [(4, 2, 3), (4, 4, 1), (9, 3, 6)])
def test_elimination_solves_the_system_of_all_stages(c_compiler, tmp_path, seed, n, n_x, columns):
    """Against LAPACK, for Jacobians whose first pivots are zero; the bound is that of Gaussian elimination (Golub & Van
    Loan 2013, section 3.4.6) with room for growth: 1000 roundings times the condition."""
    rng = np.random.default_rng(seed)
    inverse = np.linalg.inv(radau(COUNT)[1])
    filled = rng.random((n, n)) < 0.7
    np.fill_diagonal(filled, np.arange(n) < n_x)
    coordinates = np.arange(n_x, n)
    filled[coordinates, np.roll(coordinates, 1)] = True
    pattern = ca.sparsify(ca.DM(filled.astype(float))).sparsity()
    mass, h = np.append(np.ones(n_x - 1), 0.0), 0.02
    jacobians = [
        np.where(filled, rng.normal(size=(n, n)) * 10.0 ** rng.integers(-3, 4, size=(n, 1)), 0.0) for _ in range(COUNT)
    ]
    right = rng.normal(size=(n * COUNT, columns))
    rows = np.array([h] * n_x + [1.0] * (n - n_x))
    system = np.kron(inverse, np.diag([*mass, *[0.0] * (n - n_x)]))
    for k, jacobian in enumerate(jacobians):
        system[k * n : (k + 1) * n, k * n : (k + 1) * n] -= rows[:, None] * jacobian
    expected = np.linalg.solve(system, right)
    entries = np.array([jacobian.T[filled.T] for jacobian in jacobians])
    for kept in (1, COUNT):
        body = dense.solved_in_lanes(pattern, inverse, n_x, columns, kept, np.ones(n))
        result = np.zeros((columns, n * kept))
        call = called(c_compiler, tmp_path / str(kept), body)
        call([entries, mass, np.array([h]), right.T.copy()], result)
        scaled = system / np.linalg.norm(system, axis=1, keepdims=True)
        error = np.linalg.norm(result.T - expected[-n * kept :]) / np.linalg.norm(expected)
        assert error < 1000 * np.finfo(float).eps * np.linalg.cond(scaled)


def test_large_systems_are_left_to_the_sparse_method():
    inverse = np.eye(COUNT)
    size = dense.MOST // COUNT
    larger = ca.Sparsity.dense(size + 1, size + 1)
    assert dense.solved_in_lanes(larger, inverse, size, 1, 1, np.ones(size + 1)) is not None
    assert dense.solved_in_lanes(larger, inverse, size + 1, 1, 1, np.ones(size + 1)) is None
    assert dense.solved_in_lanes(ca.Sparsity.dense(size, size), inverse, 1, 0, 1, np.ones(size)) is None


def test_a_stage_that_does_not_give_its_coordinates_is_left_to_the_sparse_method():
    pattern = ca.sparsify(ca.DM([[1, 1, 1], [1, 0, 1], [1, 0, 0]])).sparsity()
    assert dense.solved_in_lanes(pattern, np.eye(COUNT), 1, 1, 1, np.ones(3)) is None
    assert dense.solved_in_lanes(pattern + ca.Sparsity.diag(3), np.eye(COUNT), 1, 1, 1, np.ones(3)) is not None


@pytest.mark.parametrize("coordinates", [1, 3])
@pytest.mark.parametrize(("share", "solved"), [(1.0, True), (1e-6, True), (1e-9, False), (0.0, False), (np.nan, False)])
def test_a_stage_that_hardly_gives_its_coordinates_is_not_solved(c_compiler, tmp_path, coordinates, share, solved):
    """One coordinate, and a chain of three that each tell the next one with the cube root of the share. What is left of
    a row grows by the inverse of the share; 100 roundings of that are room for the rest."""
    n, inverse, h = 1 + coordinates, np.linalg.inv(radau(COUNT)[1]), 0.02
    jacobian = np.diag([-3.0, *[share ** (1 / coordinates)] * coordinates]) + np.diag(
        [2.0, *[1.0] * (coordinates - 1)], 1
    )
    jacobian[-1, 0] += 1.0
    filled = ~(jacobian == 0.0) | np.eye(n, dtype=bool)
    body = dense.solved_in_lanes(ca.sparsify(ca.DM(filled.astype(float))).sparsity(), inverse, 1, 1, COUNT, np.ones(n))
    call = called(c_compiler, tmp_path, body)
    result, right = np.zeros((1, n * COUNT)), np.linspace(1.0, 2.0, n * COUNT)
    entries = np.tile(jacobian.T[filled.T], (COUNT, 1))
    assert (call([entries, np.ones(1), np.array([h]), right], result) == 0) == solved
    if solved:
        only = np.diag([1.0, *[0.0] * coordinates])
        rows = np.diag([h, *[1.0] * coordinates])
        system = np.kron(inverse, only) - np.kron(np.eye(COUNT), rows @ jacobian)
        error = np.linalg.norm(system @ result[0] - right) / (np.linalg.norm(system) * np.linalg.norm(result))
        assert error < 100 * np.finfo(float).eps / share


@pytest.mark.parametrize(("scale", "solved"), [(1e-12, True), (1.0, False)])
def test_a_coordinate_counts_against_what_a_state_makes_of_its_row(c_compiler, tmp_path, scale, solved):
    """A state in picometres: its entries are large, what it does is not. Without its scale the share would be 1e-12."""
    inverse, h = np.linalg.inv(radau(COUNT)[1]), 0.02
    body = dense.solved_in_lanes(ca.Sparsity.dense(2, 2), inverse, 1, 1, COUNT, np.array([scale, 1.0]))
    call = called(c_compiler, tmp_path, body)
    result, right = np.zeros((1, 2 * COUNT)), np.linspace(1.0, 2.0, 2 * COUNT)
    entries = np.tile([-3.0, 1e12, 2e-12, 1.0], (COUNT, 1))  # column by column: x' = -3x + 2e-12 z, 0 = 1e12 x + z
    assert (call([entries, np.ones(1), np.array([h]), right], result) == 0) == solved
    if solved:
        in_units = np.kron(inverse, np.diag([1.0, 0.0])) - np.kron(np.eye(COUNT), [[-3.0 * h, 2.0 * h], [1.0, 1.0]])
        units = np.tile([1e-12, 1.0], COUNT)
        expected = units * np.linalg.solve(in_units, right / units)
        np.testing.assert_allclose(result[0], expected, rtol=1e-12)  # two hundred roundings and a condition of ten


def called(c_compiler, folder, body, helper=""):
    """A C function of this body, to be called with arrays for arguments and results."""
    folder.mkdir(exist_ok=True)
    code, library = folder / "f.c", folder / "f.so"
    code.write_text(f"#include <math.h>\n{helper}\n{CALL} {{\n{body}\n}}\n")
    subprocess.run([c_compiler, "-O1", "-fPIC", "-shared", str(code), "-o", str(library), "-lm"], check=True)
    function, pointer = ctypes.CDLL(str(library)).f, ctypes.c_void_p

    def call(arguments, *results):
        of_arguments = (pointer * len(arguments))(*(a.ctypes.data for a in arguments))
        of_results = (pointer * len(results))(*(None if r is None else r.ctypes.data for r in results))
        return function(of_arguments, of_results, None, None, 0)

    return call


def test_what_it_cannot_write_it_leaves():
    x = ca.SX.sym("x")
    assert lanes.in_lanes(ca.Function("f", [x], [ca.erfinv(x)]), varying=[0]) is None
    assert lanes.in_lanes(ca.Function("f", [x], [x * np.inf]), varying=[0]) is None


def test_the_plants_code_has_the_function_that_is_exchanged(base):
    # This holds CasADi to the layout of the code that it writes.
    step = step_functions(base.equations)
    generator = ca.CodeGenerator("plant.c")
    generator.add(step.sensitive)
    source = generator.dump()
    exchange = step.in_lanes()
    assert set(exchange.bodies) == {
        "stage_residual",
        "stage_values",
        "stage_jacobian",
        "stage_jacobians",
        "stage_derivatives",
        "stage_slopes",
    }
    assert set(exchange.beginnings) == {"all_stages", "last_stage"}
    for name, body in exchange.bodies.items():
        exchanged = lanes.Exchange(bodies={name: body}).into(source)
        assert body in exchanged
        assert source.count("\nstatic int ") == exchanged.count("\nstatic int ")
    for name, beginning in exchange.beginnings.items():
        begun = lanes.Exchange(beginnings={name: beginning}).into(source)
        assert begun.replace(f"{beginning}\n", "") == source and begun.count(beginning) == 1
    whole = exchange.into(source)
    for name, helper in exchange.helpers.items():
        assert whole.index(helper) < whole.rindex(f"{name}(")
    assert lanes.Exchange(bodies={"unknown": body}, helpers=exchange.helpers).into(source) == source
