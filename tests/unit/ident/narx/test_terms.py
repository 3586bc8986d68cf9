"""Terms print, parse, and evaluate as the literature writes them."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest

from deatwin.ident.narx import Frols, Grow, Lasso, Narmax, Semp, SvbNarx, Term, TermTable, generate_terms
from deatwin.ident.narx.preprocess import choose_orders
from deatwin.ident.narx.terms import AtMost, channel_lags, lags_anywhere
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


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


def make_recording(n=400, seed=0):
    """y(k) = 0.6 y(k-1) + 0.5 u(k-1) + 0.3 w(k-5) + 0.4 u(k-1)w(k-5)."""
    rng = np.random.default_rng(seed)
    u, w = rng.uniform(-1, 1, (2, n))
    y = np.zeros(n)
    for k in range(5, n):
        y[k] = 0.6 * y[k - 1] + 0.5 * u[k - 1] + 0.3 * w[k - 5] + 0.4 * u[k - 1] * w[k - 5]
    y += 1e-3 * rng.standard_normal(n)
    return Recording.from_arrays([u, w], y, 1.0, input_names=["u", "w"], output_names=["y"])


LAGS = {"u": [1, 2], "w": [4, 5, 6]}
TRUE = {"y(k-1)", "u1(k-1)", "u2(k-5)", "u1(k-1)u2(k-5)"}


@pytest.mark.parametrize("lags", [LAGS, [[1, 2], [4, 5, 6]], ((2, 1), range(4, 7)), {"w": [4, 5, 6], "u1": 2}])
def test_ways_to_give_the_same_lags(lags):
    assert channel_lags(lags, "u", 2, ["u", "w"]) == ((1, 2), (4, 5, 6))


@pytest.mark.parametrize(
    "identifier", [Frols(criterion="bic"), Lasso(), Semp(), Grow(), SvbNarx(), Narmax(Frols(criterion="bic"))], ids=repr
)
def test_each_identifier_finds_the_terms_among_the_lags_of_each_input(identifier):
    inner = identifier.process if isinstance(identifier, Narmax) else identifier
    inner.set_params(input_lags=LAGS, output_lags=[1])
    model = identifier.fit(make_recording()).model_
    assert inner.input_lags is LAGS
    assert {str(term) for term in model.terms} >= TRUE
    held = {(v.channel, v.lag) for term in model.terms for v, _ in term.factors if v.kind == "u"}
    assert held <= {(1, 1), (1, 2), (2, 4), (2, 5), (2, 6)}


def test_outputs_have_their_own_lags_too():
    terms = generate_terms({"y1": [1], "y2": [3]}, [[1], []], 1, n_inputs=2, n_outputs=2)
    assert [str(term) for term in terms] == ["1", "y1(k-1)", "y2(k-3)", "u1(k-1)"]
    data = make_recording()
    both = Recording.from_arrays(
        data.inputs, np.vstack([data.outputs, -data.outputs]), 1.0, input_names=["u", "w"], output_names=["a", "b"]
    )
    model = Frols(output_lags={"a": 1, "b": [2]}, input_lags=LAGS, degree=1).fit(both).model_
    assert {str(t) for t in model.terms if "y" in str(t)} <= {"y1(k-1)", "y2(k-2)"}


@pytest.mark.parametrize(
    ("lags", "says"),
    [
        ({"u": [1], "v": [1]}, "input_lags name 'v'.*the inputs are u, w"),
        ({"u": [1]}, r"leave out w; give \[\]"),
        ({"u": [1], "u1": [2], "w": 1}, "name the input u twice"),
        ([[1], [2], [3]], "the lags of 3 inputs; there are 2"),
        ([[1], [-1]], "at least 0"),
        ([[1], "w"], "must be integers"),
        (Fraction(1, 2), "give a number"),
    ],
)
def test_lags_that_make_no_sense_are_refused_with_what_would(lags, says):
    with pytest.raises(ModelError, match=says):
        Frols(input_lags=lags).fit(make_recording())


def test_a_name_of_a_recording_goes_before_a_name_by_position():
    assert channel_lags({"u2": [1], "other": [7]}, "u", 2, ["u2", "other"]) == ((1,), (7,))


def test_lags_of_each_input_are_points_of_the_choice_of_orders():
    data = make_recording()
    found = choose_orders(
        Frols(), data.section(0, 250), data.section(250, 400), output_lags=[1], input_lags=[LAGS], degrees=[2]
    )
    assert found.best.input_lags == LAGS and found.best.error < 0.01
    assert lags_anywhere(LAGS) == (1, 2, 4, 5, 6) and lags_anywhere(3) == (1, 2, 3)


def texts(rule):
    return [str(term) for term in generate_terms(2, 1, 2, rule=rule)]


@pytest.mark.parametrize(
    ("rule", "dropped"),
    [
        (AtMost(output=1), {"y(k-1)^2", "y(k-1)y(k-2)", "y(k-2)^2"}),
        (AtMost(input=0), {"u(k-1)", "y(k-1)u(k-1)", "y(k-2)u(k-1)", "u(k-1)^2"}),
    ],
)
def test_a_rule_drops_what_it_says(rule, dropped):
    every, kept = texts(None), texts(rule)
    assert set(every) - set(kept) == dropped and kept == [text for text in every if text not in dropped]


def test_a_rule_that_leaves_nothing_and_one_that_prints():
    with pytest.raises(ModelError, match="leaves none of 10"):
        texts(lambda term: False)
    assert "AtMost(output=1, input=None)" in repr(Frols(rule=AtMost(output=1)))
