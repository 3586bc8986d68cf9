"""The free run, the innovations and the simulation errors: compiled and in plain Python."""

import logging
import math
from itertools import pairwise
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.signal import lfilter, lfiltic

from deatwin.ident.narx.free_run import March, free_run, innovations
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.integrator import compiled


@pytest.fixture(params=["compiled", "plain"])
def way(request, monkeypatch):
    """Both ways of marching."""
    if request.param == "plain":
        monkeypatch.setenv("DEATWIN_COMPILER", "")
    else:
        request.getfixturevalue("c_compiler")
    return request.param


def table(*texts):
    return TermTable(tuple(Term.parse(text) for text in texts))


# Blocks of the kernel are 256 samples long: within one, at its end, across several.
@pytest.mark.parametrize("n", [3, 200, 256, 258, 259, 1000])
def test_a_linear_model_is_a_filter(way, n):
    rng = np.random.default_rng(n)
    u, y = rng.normal(size=(1, n)), rng.normal(size=(1, n))
    terms = table("y(k-1)", "u(k-2)", "y(k-2)", "u(k)")
    theta = np.array([1.4, 0.3, -0.8, 0.7])
    run, failed = free_run(terms, theta, u, y, 1e6)
    a, b = [1.0, -1.4, 0.8], [0.7, 0.0, 0.3]
    state = lfiltic(b, a, y=y[0, 1::-1], x=u[0, 1::-1])
    expected = lfilter(b, a, u[0, 2:], zi=state)[0]
    assert failed is None
    np.testing.assert_array_equal(run[0, :2], y[0, :2])
    # A stable filter does not amplify the rounding of the order of summation by more than its gain, about ten.
    np.testing.assert_allclose(run[0, 2:], expected, rtol=0, atol=1e-13 * max(1.0, np.abs(expected).max()) * 10)


def loop(n, first, start, equation):
    """March by hand: equation(k, y) gives the outputs at k."""
    y = start.copy()
    for k in range(first, n):
        y[:, k] = equation(k, y)
    return y


def test_a_nonlinear_model_of_two_outputs_is_its_equations(way):
    n, rng = 700, np.random.default_rng(1)
    u, start = rng.uniform(-1, 1, (2, n)), rng.uniform(-0.1, 0.1, (2, n))
    texts = ["u1(k-1)^2", "y2(k-1)y1(k-3)", "y1(k-1)", "1", "y2(k-2)u2(k)", "y1(k-1)^2u1(k-2)"]
    theta = np.array([0.4, -0.5, 0.6, 0.1, 0.3, -0.2])
    run, failed = free_run(table(*texts), theta, u, start, 1e3, equations=[0, 0, 0, 1, 1, 1])

    def equation(k, y):
        return (
            0.4 * u[0, k - 1] ** 2 - 0.5 * y[1, k - 1] * y[0, k - 3] + 0.6 * y[0, k - 1],
            0.1 + 0.3 * y[1, k - 2] * u[1, k] - 0.2 * y[0, k - 1] ** 2 * u[0, k - 2],
        )

    assert failed is None
    np.testing.assert_allclose(run, loop(n, 3, start, equation), rtol=0, atol=1e-13)
    # The order of the terms, and that they come mixed, does not matter.
    order = [4, 0, 3, 2, 5, 1]
    again, _ = free_run(
        table(*(texts[i] for i in order)), theta[order], u, start, 1e3, equations=[(0, 0, 0, 1, 1, 1)[i] for i in order]
    )
    np.testing.assert_allclose(again, run, rtol=0, atol=1e-13)


def test_innovations_are_the_noise_that_made_the_record(way):
    n, rng = 600, np.random.default_rng(3)
    u, e = rng.uniform(-1, 1, (1, n)), 0.1 * rng.normal(size=(1, n))
    e[:, :2] = 0.0
    y = loop(
        n,
        2,
        np.zeros((1, n)),
        lambda k, y: (
            0.5 * y[:, k - 1] + 0.8 * u[:, k - 2] + 0.4 * e[:, k - 1] - 0.3 * u[:, k - 1] * e[:, k - 2] + e[:, k]
        ),
    )
    terms = table("y(k-1)", "e(k-1)", "u(k-2)", "u(k-1)e(k-2)")
    found = innovations(terms, np.array([0.5, 0.4, 0.8, -0.3]), u, y)
    np.testing.assert_array_equal(found[:, :2], 0.0)
    np.testing.assert_allclose(found, e, rtol=0, atol=1e-13)


def test_a_divergence_tells_its_sample_and_holds_the_last_value(way):
    y = np.array([[1.0] + [0.0] * 19])
    run, failed = free_run(table("y(k-1)"), np.array([2.0]), np.zeros((1, 20)), y, 100.0)
    assert failed == 7  # 2^7 is the first power beyond 100
    np.testing.assert_array_equal(run[0], [1, 2, 4, 8, 16, 32] + [64] * 14)
    run, failed = free_run(table("1"), np.array([math.nan]), np.zeros((1, 5)), np.ones((1, 5)), 100.0)
    assert failed == 0 and not run.any()


def test_a_noise_model_that_is_not_invertible_stays_finite(way):
    found = innovations(table("e(k-1)"), np.array([2.0]), np.zeros((1, 3000)), np.ones((1, 3000)))
    assert np.isfinite(found).all() and abs(found[0, -1]) > 1e300


def test_simulation_errors_of_many_models_are_those_of_their_free_runs(way):
    """Candidates of a bilinear system, its record, and models of two terms each."""
    n, rng = 777, np.random.default_rng(5)
    u, start = rng.uniform(-1, 1, (1, n)), rng.uniform(-1, 1, (1, n))
    y = loop(n, 2, start, lambda k, y: 0.5 * y[:, k - 1] + 0.6 * y[:, k - 2] * u[:, k - 1] + 0.3 * rng.normal())
    candidates = table("y(k-1)", "y(k-2)u(k-1)", "u(k-1)^2", "1", "y(k-2)^3").terms
    models = np.array([[0, 1], [1, 2], [3, 0], [2, 3], [4, 4]])
    thetas = np.array([[0.5, 0.6], [0.7, -0.2], [0.1, 0.9], [1.0, -1.0], [900.0, 0.0]])
    march = March.of(candidates, {"u": u}, "y", y, first=2)
    errors = march.squared_errors(models, thetas, limit=1e3, sections=4)
    stops = 2 + np.arange(5) * (n - 2) // 4
    for found, chosen, theta in zip(errors[:4], models, thetas, strict=False):
        # With an idle term of the largest lag, for all models start where the candidates' largest lag ends.
        terms = TermTable((*(candidates[i] for i in chosen), Term.parse("y(k-2)^2")))
        run, _ = free_run(terms, np.append(theta, 0.0), u, y, 1e3)
        squares = (y - run)[0] ** 2
        np.testing.assert_allclose(found, [squares[a:b].sum() for a, b in pairwise(stops)], rtol=1e-12)
    assert np.isinf(errors[4]).all()  # 900 y^3 blows up


def test_recordings_are_marched_one_after_another(way):
    """Runs and squared errors of each recording are those of a march over it alone, by sections and with its limit."""
    rng, lengths = np.random.default_rng(8), np.array([700, 4, 31])
    parts = [(rng.uniform(-1, 1, (1, n)), rng.uniform(-1, 1, (1, n))) for n in lengths]
    u, y = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    terms, theta = table("y(k-1)u(k-2)", "sat(y(k-1)-y(k-2),0.5)", "u(k-1)", "1").terms, np.array([0.5, 0.3, 0.2, 0.1])
    march = March.of(terms, {"u": u}, "y", y, first=2, ends=np.cumsum(lengths))
    run, failed = march.run(theta, limit=1e3)
    alone = [March.of(terms, {"u": inputs}, "y", outputs, first=2) for inputs, outputs in parts]
    np.testing.assert_array_equal(run, np.concatenate([one.run(theta)[0] for one in alone], axis=1))
    assert failed is None
    sections = [3, 1, 2]
    errors = march.squared_errors(np.arange(4)[None], theta[None], limit=1e3, sections=sections)
    apart = [
        one.squared_errors(np.arange(4)[None], theta[None], limit=1e3, sections=n)
        for one, n in zip(alone, sections, strict=True)
    ]
    np.testing.assert_allclose(errors, np.concatenate(apart, axis=1), rtol=1e-12)
    limits = np.array([1e3, 1e3, np.abs(run[0, 706:735]).max() * 0.999])
    assert march.run(theta, limit=limits)[1] == 706 + np.argmax(np.abs(run[0, 706:735]))
    assert np.isinf(march.squared_errors(np.arange(4)[None], theta[None], limit=limits)).all()


def test_one_output_can_be_marched_alone(way):
    n, rng = 300, np.random.default_rng(6)
    u, y = rng.uniform(-1, 1, (1, n)), rng.uniform(-1, 1, (2, n))
    terms = table("y1(k-1)y2(k-1)", "y2(k-2)", "u(k-1)").terms
    march = March.of(terms, {"u": u, "y": y}, "y", y[[1]], first=2, alone=1)
    run, _ = march.run(np.array([0.5, 0.3, 0.2]))
    expected = y[[1]].copy()
    for k in range(2, n):
        expected[0, k] = 0.5 * y[0, k - 1] * expected[0, k - 1] + 0.3 * expected[0, k - 2] + 0.2 * u[0, k - 1]
    np.testing.assert_allclose(run, expected, rtol=0, atol=1e-13)


@pytest.mark.usefixtures("c_compiler")
def test_code_that_cannot_be_compiled_is_none_and_said(monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    monkeypatch.delenv(compiled.SAID, raising=False)
    with caplog.at_level(logging.WARNING, logger=compiled.logger.name):  # whatever a command before has made quiet
        assert compiled.compile_source("this is not C") is None
        assert compiled.compile_source("this is not C") is None
    assert len(caplog.records) == 1 and "could not compile" in caplog.text
    library = compiled.compile_source("int answer(void) { return 42; }")
    assert library is not None and library.parent == tmp_path
    assert compiled.load_source("int answer(void) { return 42; }").answer() == 42
    monkeypatch.setattr(compiled.ctypes, "CDLL", Mock(side_effect=OSError("no execution from this folder")))
    assert compiled.load_source("int answer(void) { return 42; }") is None
