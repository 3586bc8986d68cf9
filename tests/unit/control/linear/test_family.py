"""Linear models of many samples at once against those of each sample alone."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.control.linear.family import LinearFamily, linearise_many
from deatwin.control.linear.model import LinearStatus
from deatwin.control.linear.narx import linearise
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError, ReadingTime

POINTS = np.linspace(1.4, 3.2, 4)


@pytest.fixture(scope="module")
def family(model) -> tuple[np.ndarray, LinearFamily]:
    thetas = draw_theta(model, np.random.default_rng(1), 8)
    return thetas, linearise_many(model, POINTS, thetas)


def test_each_member_is_the_model_of_its_parameters_linearised_alone(model, family):
    thetas, many = family
    assert (many.n_points, many.n_samples) == (4, 8)
    for i, point in enumerate(POINTS):
        for k, theta in enumerate(thetas):
            one, member = linearise(replace(model, theta=theta), point), many.at(i, k)
            np.testing.assert_allclose(member.numerator, one.numerator, rtol=1e-10, atol=1e-10 * one.numerator.max())
            np.testing.assert_allclose(member.denominator, one.denominator, rtol=1e-10)
            assert member.operating_output == pytest.approx(one.operating_output, rel=1e-10)
            assert member.operating_input == pytest.approx(one.operating_input)
            assert (member.input_name, member.output_unit) == (one.input_name, one.output_unit)
            assert many.stable[i, k] == (np.abs(one.poles) < 1.0).all()
            assert many.static_gains[i, k] == pytest.approx(one.static_gain, rel=1e-9)
            np.testing.assert_allclose(
                np.sort_complex(many.poles[i, k]), np.sort_complex(one.poles), rtol=1e-6, atol=1e-9
            )


def test_the_loop_sees_each_member_as_it_sees_the_model_alone(family):
    _, many = family
    seen = many.in_loop(ReadingTime.END_OF_HOLD)
    expected = many.at(2, 5).in_loop(ReadingTime.END_OF_HOLD)
    np.testing.assert_array_equal(seen.at(2, 5).numerator, expected.numerator)
    with pytest.raises(ModelError, match="input lag 0"):
        many.in_loop(ReadingTime.START_OF_HOLD)
    assert seen.in_loop(ReadingTime.START_OF_HOLD) is seen


def test_a_cubic_spring_keeps_to_its_branch():
    # y = y + 0.1 (u + y - y^3): three equilibria below |u| = 0.385, the outer ones stable; the data are at the upper.
    terms = {"y(k-1)": 1.1, "y(k-1)^3": -0.1, "u(k-1)": 0.1}
    model = NarxModel.from_terms(terms, sample_time=0.1, theta_cov=np.zeros((3, 3)))
    middle = linearise_many(model, [0.0, 0.5], [model.theta])
    # From zero output on: the middle one, which is unstable; above the fold there is but the upper one.
    assert [middle.at(i, 0).status for i in (0, 1)] == [LinearStatus.UNSTABLE, LinearStatus.OK]
    upper = np.roots([-1.0, 0.0, 1.0, 0.5]).real.max()
    assert middle.operating_outputs[1, 0] == pytest.approx(upper, rel=1e-12)
    assert middle.poles[1, 0, 0] == pytest.approx(1.1 - 0.3 * upper**2, rel=1e-12)


def test_members_without_an_equilibrium_are_no_numbers_that_mislead():
    # y = y^2 + c + 0.25 with c from -0.2 to 0.2: equilibria at 1/2 ± sqrt(-c), none for positive c.
    model = NarxModel.from_terms({"y(k-1)^2": 1.0, "1": 0.05, "u(k-1)": 1.0}, sample_time=1.0)
    thetas = np.array([[1.0, 0.05, 1.0], [1.0, 0.24, 1.0], [1.0, 0.26, 1.0], [1.0, 0.05, 0.0], [1.0, 0.4, 1.0]])
    many = linearise_many(model, [0.0], thetas)
    assert many.exists[0].tolist() == [True, True, False, True, False]
    assert many.at(0, 2).status is LinearStatus.NO_EQUILIBRIUM
    assert many.at(0, 3).status is LinearStatus.NO_GAIN
    assert np.isfinite(many.numerators).all() and np.isfinite(many.denominators).all()
    assert np.isnan(many.static_gains[0, 2]) and np.isnan(many.poles[0, 4]).all()
    assert many.operating_outputs[0, 1] == pytest.approx(0.5 - np.sqrt(0.01), rel=1e-9)


def test_an_integrator_has_no_equilibrium():
    model = NarxModel.from_terms({"y(k-1)": 1.0, "u(k-1)": 1.0}, sample_time=1.0)
    assert not linearise_many(model, [0.0, 1.0]).exists.any()
    almost = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0)
    assert linearise_many(almost, [1.0], [[0.5, 1.0], [1.0, 1.0]]).exists.tolist() == [[True, False]]


def test_a_model_of_inputs_alone_has_no_poles():
    model = NarxModel.from_terms({"u(k)": 1.0, "u(k-1)": 0.5, "u(k-1)^2": 1.0}, sample_time=1.0)
    many = linearise_many(model, [1.0])
    np.testing.assert_allclose(many.numerators[0, 0], [1.0, 2.5])
    assert many.poles.shape == (1, 1, 0) and many.stable.all()


def test_models_of_different_length_are_filled_up():
    models = [
        linearise(NarxModel.from_terms(t, sample_time=1.0))
        for t in ({"y(k-1)": 0.5, "u(k-1)": 1.0}, {"y(k-1)": 0.2, "y(k-2)": 0.3, "u(k)": 1.0}, {"y(k-1)": 1.0})
    ]
    family = LinearFamily.of([models])
    assert family.numerators.tolist() == [[[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]]
    assert family.denominators.tolist() == [[[1.0, -0.5, 0.0], [1.0, -0.2, -0.3], [1.0, 0.0, 0.0]]]
    assert family.exists.tolist() == [[True, True, False]]
    assert [family.at(0, k).status for k in range(3)] == [m.status for m in models]


@pytest.mark.parametrize(
    ("points", "thetas", "match"),
    [
        ([], None, "at least one"),
        ([np.nan], None, "finite"),
        ([1.0], [[1.0]], "2 in a row"),
        ([1.0], [[np.inf, 1.0]], "finite"),
    ],
)
def test_bad_input_is_refused(points, thetas, match):
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0)
    with pytest.raises(ModelError, match=match):
        linearise_many(model, points, thetas)


def test_one_input_only_and_rows_of_one_length():
    two = NarxModel.from_terms({"u1(k-1)": 1.0, "u2(k-1)": 1.0}, sample_time=1.0)
    with pytest.raises(ModelError, match="2 inputs"):
        linearise_many(two, [1.0])
    one = linearise(NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0))
    with pytest.raises(ModelError, match="as many at each"):
        LinearFamily.of([[one], [one, one]])


@pytest.mark.parametrize(("field", "value"), [("sample_time", 0.5), ("input_unit", "mV"), ("output_name", "force")])
def test_models_of_other_signals_are_no_family(field, value):
    one = linearise(NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0))
    with pytest.raises(ModelError, match=f"they have {field} "):
        LinearFamily.of([[one], [replace(one, **{field: value})]])


def test_a_text_is_no_reading_time():
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=0.1)
    for source in (linearise(model, 0.0), linearise_many(model, [0.0])):
        with pytest.raises(ModelError, match="reading is 'start of hold'; it must be one of ReadingTime"):
            source.in_loop("start of hold")
