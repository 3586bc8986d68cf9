"""Terms with the names of the recording's signals, read and written."""

import numpy as np
import pytest

from deatwin.ident.narx import Fixed, NarxModel, Term
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.variables import symbols_of
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

THETA = {"y(k-1)": 0.6, "u(k-1)": 0.5, "w(k-5)": 0.3, "u(k-1)w(k-5)": 0.4}


def make_recording(input_names=("u", "w"), output_names=("y",), n=200):
    rng = np.random.default_rng(0)
    u, w = rng.uniform(-1, 1, (2, n))
    y = np.zeros(n)
    for k in range(5, n):
        y[k] = 0.6 * y[k - 1] + 0.5 * u[k - 1] + 0.3 * w[k - 5] + 0.4 * u[k - 1] * w[k - 5]
    return Recording.from_arrays([u, w], y, 1.0, input_names=input_names, output_names=output_names)


@pytest.mark.parametrize("product", ["u(k-1)w(k-5)", "u(k-1)*w(k-5)", "w(k - 5) * u( k-1 )", "u1(k-1)w(k-5)"])
def test_terms_are_read_and_printed_in_the_names_of_the_recording(product):
    model = Fixed(terms=["y(k-1)", "u(k-1)", "w(k-5)", product]).fit(make_recording()).model_
    assert np.allclose(model.theta, list(THETA.values()), atol=1e-12)
    assert str(model) == "y(k) = 0.6 y(k-1) + 0.5 u(k-1) + 0.3 w(k-5) + 0.4 u(k-1)w(k-5) + e(k)"


@pytest.mark.parametrize(
    ("input_names", "output_name", "printed"),
    [
        (("motor voltage", "T-T0"), "x+1", "u1(k-1)"),  # names that are no words are read, but not printed
        (("U_in", "Temperatur_außen"), "weg", "U_in(k-1)"),
        (("uu", "u"), "y1", "uu(k-1)"),
        (("(a)", "(a)(k-1)"), "^2", "u1(k-1)"),
    ],
)
def test_names_of_all_kinds_are_read(input_names, output_name, printed):
    u, w = input_names
    terms = [f"{output_name}(k-1)", f"{u}(k-1)", f"{w}(k-5)", f"{u}(k-1){w}(k-5)"]
    model = Fixed(terms=terms).fit(make_recording(input_names, (output_name,))).model_
    assert np.allclose(model.theta, list(THETA.values()), atol=1e-12)
    assert printed in str(model)


def test_a_name_of_the_recording_goes_before_a_position():
    recording = make_recording(input_names=("u2", "u1"))
    model = Fixed(terms=["y(k-1)", "u2(k-1)", "u1(k-5)", "u2(k-1)u1(k-5)"]).fit(recording).model_
    assert np.allclose(model.theta, list(THETA.values()), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        *(
            (t, r"the signal 'v'.*inputs: u \(or u1\), w \(or u2\), outputs: y")
            for t in ("v(k-1)", "u(k-1)v(k-5)", "y(k-1)*v(k-5)")
        ),
        *((t, "cannot read the term") for t in ("|u(k-1)", "sign(u)", "u(k-1)+w(k-1)", "u(k-1", "v(k+1)")),
        ("u3(k-1)", "3 inputs, the recordings have 2: u, w"),
    ],
)
def test_a_name_that_is_unknown_and_what_is_no_term_are_refused_with_what_exists(text, says):
    with pytest.raises(ModelError, match=says):
        Fixed(terms=[text]).fit(make_recording())


def test_a_name_that_two_signals_bear_is_refused_where_it_is_used():
    recording = make_recording(input_names=("x", "w"), output_names=("x",))
    with pytest.raises(ModelError, match=r"'x' names several signals.*u1, y"):
        Fixed(terms=["x(k-1)"]).fit(recording)
    assert "y(k) = " in str(Fixed(terms=["y(k-1)", "u1(k-1)"]).fit(recording).model_)


def test_a_model_is_made_of_terms_in_its_own_names():
    terms = {"left": {"left(k-1)": 0.5, "force(k-1)": 1.0}, "right": {"left(k-2)right(k-1)": 0.1, "e2(k-1)": 0.2}}
    names = {"input_names": ("force",), "input_units": ("N",), "output_names": ("left", "right")}
    model = NarxModel.from_terms(terms, sample_time=1.0, output_units=("m", "m"), **names)
    assert [str(term) for term in model.terms] == ["y1(k-1)", "u(k-1)", "y1(k-2)y2(k-1)", "e2(k-1)"]
    assert str(model).splitlines() == [
        "left(k) = 0.5 left(k-1) + 1 force(k-1) + e1(k)",
        "right(k) = 0.1 left(k-2)right(k-1) + 0.2 e2(k-1) + e2(k)",
    ]
    assert Term.parse("left(k-1)", output_names=["left", "right"]) == model.terms[0]


def test_terms_of_several_outputs_are_given_by_their_names():
    data = make_recording()
    both = Recording.from_arrays(
        data.inputs, np.vstack([data.outputs, -2 * data.outputs]), 1.0, input_names=["u", "w"], output_names=["a", "b"]
    )
    model = Fixed(terms={"b": ["a(k-1)", "u(k-1)"], "a": ["a(k-1)", "w(k-5)"]}).fit(both).model_
    assert model.equations == (0, 0, 1, 1) and [str(t) for t in model.terms][1] == "u2(k-5)"


@pytest.mark.parametrize(
    ("inputs", "outputs", "symbols"),
    [
        (["command"], ["displacement"], {"u": "u", "y": "y"}),
        (["input_1"], ["level"], {"u": "u", "y": "level"}),
        (["y"], ["output"], {"u": "u", "y": "y"}),  # or both would be y
        (["e"], ["x"], {"u": "u", "y": "y"}),  # or the noise and the input would be e
    ],
)
def test_names_that_nobody_gave_or_that_clash_are_printed_by_position(inputs, outputs, symbols):
    found = symbols_of(inputs, outputs)
    assert {kind: found[kind, 0] for kind in symbols} == symbols


def test_parameters_are_shown_in_the_prefixes_of_the_training_data() -> None:
    # y in m from u in V: 2.5 mm at (1 kV)^2 is 2.5e-9 m/V^2.
    operating = OperatingRange(
        input_min=[0.0],
        input_max=[3000.0],
        input_centre=[1500.0],
        output_min=[0.0],
        output_max=[0.02],
        output_centre=[0.01],
    )
    model = NarxModel.from_terms(
        {"y(k-1)": 0.5, "u(k-2)^2": 2.5e-9, "1": 1e-3},
        sample_time=0.1,
        operating=operating,
        input_units=("V",),
        output_units=("m",),
    )
    assert str(model) == "y(k) = 0.5 y(k-1) + 2.5 u(k-2)^2 + 1 1 + e(k)\n(y in mm, u in kV)"


def test_si_is_kept_where_it_is_readable_or_nothing_is_known_of_the_data() -> None:
    terms = {"y(k-1)": 0.5, "u(k-1)": 1e-9}
    model = NarxModel.from_terms(terms, sample_time=0.1, input_units=("V",), output_units=("m",))
    assert str(model) == "y(k) = 0.5 y(k-1) + 1e-09 u(k-1) + e(k)"
    assert np.array_equal(model.theta, [0.5, 1e-9])
