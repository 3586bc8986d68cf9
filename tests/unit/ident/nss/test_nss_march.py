"""The run of a nonlinear state space: kernel and Python alike, sensitivities against differences, terms against hand."""

import numpy as np
import pytest

from deatwin.ident.narx import register_function
from deatwin.ident.nss.basis import Basis, monomials
from deatwin.ident.nss.march import System
from deatwin.plant.errors import ModelError

TERMS = (
    *monomials(("x1", "x2", "u1"), (2, 3)),
    "tanh(s1,1)",
    "rbf(s1,0.1,0.7) u2",
    "s1",
    "s2^2 x1",
    "|s2|",
    "hinge(s1,0.1) s2",
    "spline(x2,-0.2)",
    "sat(u1,0.4) dead(x1,0.1)",
)


def made(rng, terms=TERMS):
    """Two states, two inputs, two outputs and two directions, the second of which weighs functions of the first."""
    basis = Basis(2, 2, 2, terms)
    early = basis.levels < np.arange(1, 3)[:, None]
    transition = 0.03 * rng.normal(size=(2, basis.size))
    transition[:, 1:3] = [[0.6, 0.3], [-0.3, 0.5]]
    return System(
        basis=basis,
        directions=0.4 * rng.normal(size=(2, basis.size)) * early,
        transition=transition,
        output=rng.normal(size=(2, basis.size)),
        free_directions=(rng.random((2, basis.size)) < 0.7) & early,
        free_transition=rng.random((2, basis.size)) < 0.7,
        free_output=rng.random((2, basis.size)) < 0.7,
    )


@pytest.fixture(params=["kernel", "python"])
def loop(request, monkeypatch):
    """Both marches: the kernel where there is a compiler, and Python."""
    if request.param == "python":
        monkeypatch.setenv("DEATWIN_COMPILER", "")
    return request.param


def test_sensitivities_are_those_of_differences(loop):
    rng = np.random.default_rng(1)
    system, inputs, start = made(rng), 0.5 * rng.normal(size=(2, 25)), 0.3 * rng.normal(size=2)
    _, gradient, reached = system.run(inputs, start, sensitive=True)
    at = np.r_[system.theta, start]
    assert reached == 25 and gradient.shape == (25, 2, at.size)
    step = 1e-6  # kinks of |s2| and the like are not met: central differences are good to about 1e-9
    for i in range(0, at.size, 1 if loop == "kernel" else 9):
        direction = np.eye(at.size)[i]
        ends = [at + sign * step * direction for sign in (1, -1)]
        after, before = (system.with_theta(end[:-2]).run(inputs, end[-2:])[0] for end in ends)
        slope = (after - before) / (2 * step)
        np.testing.assert_allclose(gradient[:, :, i], slope, atol=1e-7 * max(1.0, np.abs(slope).max()))


def test_a_run_is_the_recursion_written_by_hand(loop):
    basis = Basis(1, 1, 1, ("x1^2 u", "|s1|"))
    system = System(
        basis=basis,
        directions=np.array([[0.1, 1.0, -2.0, 0.0, 0.0]]),
        transition=np.array([[0.0, 0.5, 1.0, 0.2, 0.0]]),
        output=np.array([[0.3, 1.0, 0.0, 0.0, -0.4]]),
        free_directions=np.zeros((1, 5), dtype=bool),
        free_transition=np.zeros((1, 5), dtype=bool),
        free_output=np.zeros((1, 5), dtype=bool),
    )
    x, expected, inputs = 0.7, [], [1.0, -0.5, 0.25]
    for u in inputs:
        expected.append(0.3 + x - 0.4 * abs(0.1 + x - 2.0 * u))
        x = 0.5 * x + u + 0.2 * x**2 * u
    found = system.run(np.array([inputs]), np.array([0.7]))[0]
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-14)


def test_a_function_of_ones_own_is_run_in_python():
    register_function("cubed", lambda x: x**3, lambda x: 3 * x**2)
    rng = np.random.default_rng(2)
    inputs, start = 0.5 * rng.normal(size=(2, 20)), np.zeros(2)
    own, power = (made(np.random.default_rng(3), (term, "s1", "s2")) for term in ("cubed(x1)", "x1^3"))
    for one, other in zip(
        own.run(inputs, start, sensitive=True), power.run(inputs, start, sensitive=True), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)


def test_a_run_ends_where_it_leaves_the_limit(loop):
    rng = np.random.default_rng(4)
    system = made(rng)
    outputs = system.run(0.5 * rng.normal(size=(2, 30)), np.zeros(2))[0]
    k = int(np.argmax(np.abs(outputs).max(axis=1)))
    rng = np.random.default_rng(4)
    again = made(rng).run(0.5 * rng.normal(size=(2, 30)), np.zeros(2), limit=0.999 * float(np.abs(outputs).max()))
    assert again[2] == k and np.isnan(again[0][k + 1 :]).all()


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ("x3", "'x3'; there are x1, x2, u1, u2, s1, s2"),
        ("x1^0", "power"),
        ("sin(x1)", "no function is called 'sin'"),
        ("sat(x1,a)", "'a' is not a number"),
        ("x1*x2", "neither a power as x1\\^2 nor a function"),
        ("", "needs a power or a function"),
    ],
)
def test_a_term_that_is_none_is_refused(term, message):
    with pytest.raises(ModelError, match=message):
        _ = Basis(2, 2, 2, (term,)).terms


def test_monomials_are_all_products_of_a_degree():
    assert monomials(("x1", "u"), (2,)) == ("x1^2", "x1 u", "u^2")
    assert len(monomials(("x1", "x2", "u"), (2, 3))) == 6 + 10  # (n + d - 1 over d)
