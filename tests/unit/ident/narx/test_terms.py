"""Terms print, parse, and evaluate as the literature writes them."""

from math import comb

import numpy as np
import pytest

from deatwin.ident.narx import Term, TermTable, generate_terms
from deatwin.plant.errors import ModelError


@pytest.mark.parametrize("text", ["1", "y(k-1)", "u(k)", "y(k-1)u(k-2)^2", "y(k-1)^3u(k-4)", "y1(k-1)u2(k-3)^2"])
def test_writing_and_reading_are_inverse(text):
    assert str(Term.parse(text)) == text


def test_order_of_factors_does_not_matter():
    assert Term.parse("u(k-2) * y(k-1) * u(k-2)") == Term.parse("y(k-1)u(k-2)^2")
    assert Term.parse("y(k-1)u(k-2)^2").degree == 3


@pytest.mark.parametrize("text", ["", "y", "y(k)", "x(k-1)", "y(k-1)+u(k-1)", "y(k+1)", "2 y(k-1)", None, 1])
def test_what_is_not_a_term_is_refused(text):
    with pytest.raises(ModelError):
        Term.parse(text)


@pytest.mark.parametrize(("ny", "nu", "degree"), [(4, 4, 4), (2, 3, 3), (0, 2, 2), (1, 0, 1)])
def test_number_of_candidates(ny, nu, degree):
    terms = generate_terms(ny, nu, degree)
    assert len(terms) == len(set(terms)) == comb(ny + nu + degree, degree)
    assert str(terms[0]) == "1"


def test_explicit_lags_and_channels():
    terms = {str(term) for term in generate_terms([1, 5], [0, 3], 1)}
    assert terms == {"1", "y(k-1)", "y(k-5)", "u(k)", "u(k-3)"}
    terms = {str(term) for term in generate_terms(1, 1, 1, n_inputs=2)}
    assert terms == {"1", "y(k-1)", "u1(k-1)", "u2(k-1)"}


@pytest.mark.parametrize("arguments", [(1, 1, 0), ([0], 1, 1), (1, [-1], 1), (0, 0, 2), (-1, 1, 1), ([1.5], 1, 1)])
def test_senseless_candidates_are_refused(arguments):
    with pytest.raises(ModelError):
        generate_terms(*arguments)


def test_regressors_equal_the_written_products():
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=(2, 30)), rng.normal(size=(1, 30))
    table = TermTable(tuple(map(Term.parse, ["1", "y(k-2)u1(k-1)^2", "u2(k)", "y(k-2)u1(k-1)^2u2(k-3)", "y(k-1)"])))
    assert table.max_lag == 3
    k = np.arange(3, 30)
    product = y[0, k - 2] * u[0, k - 1] ** 2
    expected = [np.ones(27), product, u[1, k], product * u[1, k - 3], y[0, k - 1]]
    np.testing.assert_allclose(table.rows(u, y, 3, 30), expected, rtol=1e-14)
    np.testing.assert_array_equal(table.rows(u, y, 10, 20), table.rows(u, y, 3, 30)[:, 7:17])
    levels = np.array([2.0 if v.kind == "y" else 3.0 for v in table.variables])
    np.testing.assert_allclose(table.at(levels), [1, 18, 3, 54, 2])


def test_too_many_candidates_are_refused_before_they_are_made():
    with pytest.raises(ModelError, match="candidate terms; at most 20000 can be handled"):
        generate_terms(30, 30, 9)
