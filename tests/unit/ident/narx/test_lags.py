"""Lags for each channel: in order and by name, in all identifiers."""

from fractions import Fraction

import numpy as np
import pytest

from deatwin.ident.narx import Frols, Grow, Lasso, Narmax, Semp, SvbNarx, generate_terms
from deatwin.ident.narx.lags import channel_lags, lags_anywhere
from deatwin.ident.narx.preprocess import choose_orders
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


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
