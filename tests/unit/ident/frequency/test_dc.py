"""Equilibria, the linear part, and the model of deviations."""

from dataclasses import replace

import numpy as np
import pytest
from made_narx import trained_on
from scipy.signal import butter
from slopes import differences

from deatwin.ident.frequency import equilibrium, gfrf, linear_part, remove_dc
from deatwin.ident.frequency.dc import deviations, remove
from deatwin.ident.narx import Fixed, NarxModel
from deatwin.ident.narx.linear.model import LinearModel
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

NONLINEAR = {
    "1": 0.1,
    "y(k-1)": 0.5,
    "y(k-2)^2": -0.2,
    "y(k-1)u(k-1)": 0.15,
    "u(k-1)": 0.4,
    "u(k-2)^3": 0.1,
    "y(k-1)y(k-2)u(k)": -0.05,
}


def near(output, input_centre=0.0, size=2.0):
    return trained_on(
        (input_centre - 1, input_centre + 1),
        (output - size, output + size),
        input_centre=input_centre,
        output_centre=output,
    )


def test_all_equilibria_with_stability_and_the_one_near_the_data():
    """y = 1.5 y - 0.5 y^3: at 0 unstable (slope 1.5), at ±1 stable (slope 0)."""
    terms = {"y(k-1)": 1.5, "y(k-1)^3": -0.5, "u(k-1)": 1.0}
    for output, chosen in [(-0.8, -1.0), (0.1, 0.0), (0.9, 1.0)]:
        point = equilibrium(NarxModel.from_terms(terms, sample_time=1.0, operating=near(output)), 0.0)
        np.testing.assert_allclose(point.outputs, [-1, 0, 1], atol=1e-14)
        np.testing.assert_array_equal(point.stable, [True, False, True])
        assert point.output == pytest.approx(chosen, abs=1e-14)


def test_equilibria_do_not_depend_on_the_unit():
    scale = 1e-6
    model = NarxModel.from_terms(
        {"y(k-1)": 1.5, "y(k-1)^3": -0.5 / scale**2, "u(k-1)": 1.0},
        sample_time=1.0,
        operating=near(0.9 * scale, size=scale),
    )
    np.testing.assert_allclose(equilibrium(model, 0.0).outputs, [-scale, 0, scale], atol=1e-13 * scale)


def test_no_equilibrium_and_every_output_one():
    with pytest.raises(ModelError, match="no real equilibrium"):
        equilibrium(NarxModel.from_terms({"y(k-1)": 1.0, "y(k-1)^2": 1.0, "u(k-1)": 1.0}, sample_time=1.0), 1.0)
    integrator = NarxModel.from_terms({"y(k-1)": 0.3, "y(k-2)": 0.7, "u(k-1)": 1.0}, sample_time=1.0)
    with pytest.raises(ModelError, match="integrates"):
        equilibrium(integrator, 0.0)
    with pytest.raises(ModelError, match="no real equilibrium"):
        equilibrium(integrator, 1.0)
    with pytest.raises(ModelError, match="operating_input"):
        equilibrium(integrator, [1.0, 2.0])


@pytest.mark.parametrize("excess", [0.0, 1e-15, -1e-16])
def test_a_fold_is_one_to_rounding(excess):
    """(y - 1/2)^2 = 0, whose root is known to the square root of the rounding."""
    fold = NarxModel.from_terms({"1": 0.25 + excess, "y(k-1)^2": 1.0, "u(k-1)": 1.0}, sample_time=1.0)
    np.testing.assert_allclose(equilibrium(fold, 0.0).outputs, 0.5, atol=1e-7)
    with pytest.raises(ModelError, match="two equilibria meet"):
        remove_dc(fold, 0.0)
    remove_dc(fold, -1e-12)  # the two are 2e-6 apart
    with pytest.raises(ModelError, match="no real equilibrium"):
        equilibrium(fold, 1e-9)


SLOW_POLES = {"oversampled": [0.995] * 4, "Butterworth": butter(8, 0.02, output="zpk")[1], "very slow": [1.0 - 1e-9]}


@pytest.mark.parametrize("poles", SLOW_POLES.values(), ids=SLOW_POLES)
def test_slow_poles_are_no_fold(poles):
    # The stiffness prod (1 - p) is 6e-10, 2e-10 and 1e-9 and known to about the rounding of the coefficients' sum.
    a = -np.poly(poles).real[1:]
    model = NarxModel.from_terms(
        {**{f"y(k-{lag})": value for lag, value in enumerate(a, 1)}, "u(k-1)": 1e-9}, sample_time=1.0
    )
    expected = 1e-9 / np.prod(1.0 - np.asarray(poles)).real
    rounding = 4 * np.finfo(float).eps * (1 + np.abs(a).sum()) * expected / 1e-9
    part = linear_part(remove_dc(model, 0.0), 0.0, 0.0)
    assert part.b.sum() / (1 - part.a.sum()) == pytest.approx(expected, rel=rounding)
    assert equilibrium(model, 2.0).output == pytest.approx(2 * expected, rel=rounding)


def test_a_linear_model_that_integrates_says_so():
    integrator = NarxModel.from_terms({"y(k-1)": 0.3, "y(k-2)": 0.7, "u(k-1)": 1.0}, sample_time=1.0)
    with pytest.raises(ModelError, match="the model integrates"):
        linear_part(integrator, 0.0, 0.0)


@pytest.mark.parametrize("term", ["u(k-1)^2", "y(k-1)u(k-1)^2"])
@pytest.mark.parametrize("size", [1e300, -1e160])
def test_coefficients_that_overflow_are_refused(term, size):
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0, term: -0.1}, sample_time=1.0)
    with pytest.raises(ModelError, match="overflow"):
        gfrf(model, 1, [0.1], operating_input=size)
    with pytest.raises(ModelError, match="overflow"):
        linear_part(NarxModel.from_terms({"y(k-1)^3": 0.5, "u(k-1)": 1.0}, sample_time=1.0), 0.0, size)


def test_a_linear_model_is_sent_elsewhere():
    model = LinearModel(a=[1.0, -0.5], b=[[0.0, 1.0]], sample_time=1.0)
    for function in (equilibrium, remove_dc):
        with pytest.raises(ModelError, match="a LinearModel is not a NarxModel; to_narx"):
            function(model)


def test_a_constant_model_rests_at_its_constant():
    model = NarxModel.from_terms({"1": 2.5}, sample_time=1.0)
    assert equilibrium(model).output == 2.5 and equilibrium(model).is_stable
    with pytest.raises(ModelError, match="nothing is left"):
        remove_dc(model)


def test_linear_part_and_its_derivatives_against_differences():
    model = NarxModel.from_terms(NONLINEAR, sample_time=1.0)

    def coefficients(theta):
        moved = NarxModel.from_terms(dict(zip(NONLINEAR, theta, strict=True)), sample_time=1.0)
        part = linear_part(moved, 0.7, equilibrium(moved, 0.7).output)
        return np.concatenate([part.a, part.b])

    part = linear_part(model, 0.7, equilibrium(model, 0.7).output)
    by_theta = np.concatenate([part.a_theta, part.b_theta])
    np.testing.assert_allclose(by_theta, differences(coefficients, model.theta, 1e-5), rtol=1e-6, atol=1e-8)


def test_poles():
    part = linear_part(NarxModel.from_terms({"y(k-1)": 1.1, "y(k-2)": -0.3}, sample_time=1.0), 0.0, 0.0)
    np.testing.assert_allclose(np.sort(part.poles.real), [0.5, 0.6], rtol=1e-12)


@pytest.mark.parametrize("operating_input", [0.0, 0.7, -0.5])
def test_the_free_run_of_the_deviations_is_that_of_the_model(operating_input):
    model = NarxModel.from_terms(NONLINEAR, sample_time=1.0)
    shifted = remove_dc(model, operating_input)
    assert "1" not in map(str, shifted.terms)
    ybar = equilibrium(model, operating_input).output
    rng = np.random.default_rng(0)
    recording = Recording.from_arrays(rng.uniform(-1, 1, 300), rng.uniform(-0.5, 0.5, 300), 1.0)
    deviations = Recording.from_arrays(recording.inputs - operating_input, recording.outputs - ybar, 1.0)
    np.testing.assert_allclose(
        shifted.simulate(deviations).outputs + ybar, model.simulate(recording).outputs, rtol=0, atol=1e-12
    )


def test_covariance_of_the_deviations_by_differences():
    root = np.random.default_rng(1).normal(size=(7, 7))
    model = NarxModel.from_terms(NONLINEAR, sample_time=1.0, theta_cov=root @ root.T)
    shifted = remove_dc(model, 0.7)

    def theta(at):
        moved = remove_dc(NarxModel.from_terms(dict(zip(NONLINEAR, at, strict=True)), sample_time=1.0), 0.7)
        assert moved.terms == shifted.terms
        return moved.theta

    jacobian = differences(theta, model.theta, 1e-5)
    np.testing.assert_allclose(shifted.theta_cov, jacobian @ root @ root.T @ jacobian.T, rtol=1e-6, atol=1e-8)


def test_the_operating_range_moves_along():
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0, operating=near(4.0, 2.0))
    shifted = remove_dc(model)
    assert shifted.operating.input_min == [-1] and shifted.operating.input_max == [1]
    assert shifted.operating.input_centre == shifted.operating.output_centre == [0]
    assert shifted.operating.output_max == [2]
    assert equilibrium(shifted).output == pytest.approx(0.0, abs=1e-15)


def test_a_recording_seen_from_an_operating_point():
    # y = 0.5 y1 + u^2 rests at 2 u^2; with u = 3 + w the square gives 6 w + w^2, and the constant goes.
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k)^2": 1.0}, sample_time=1.0)
    record = Recording.from_arrays([3.0, 3.5, 2.0], [18.0, 21.0, 14.0], 1.0)
    model = replace(
        model,
        operating=Fixed(terms=["1"])
        .fit(Recording.from_arrays([3.0] * 9, [18.0, 18.0, 18.1] * 3, 1.0))
        .model_.operating,
    )
    shifted = deviations(model)
    moved = shifted.seen(record)
    found = dict(zip(map(str, shifted.model.terms), shifted.model.theta, strict=True))
    assert found == pytest.approx({"y(k-1)": 0.5, "u(k)": 6.0, "u(k)^2": 1.0})
    np.testing.assert_allclose(moved.inputs[0], [0.0, 0.5, -1.0])
    np.testing.assert_allclose(moved.outputs[0], [0.0, 3.0, -4.0])


def test_removal_changes_nothing_and_deletion_does():
    # y = 0.6 y1 + 0.4 u + 0.1 y1^2 + 0.3: rests at 1 at zero input; v = 0.8 v1 + 0.4 w + 0.1 v1^2
    model = NarxModel.from_terms({"1": 0.3, "y(k-1)": 0.6, "u(k)": 0.4, "y(k-1)^2": 0.1}, sample_time=1.0)
    u = 0.1 * np.sin(np.arange(200.0) ** 1.3)
    removal = remove(model, Recording.from_arrays(u, np.ones(200), 1.0))
    assert dict(zip(map(str, removal.shifted.model.terms), removal.shifted.model.theta, strict=True)) == pytest.approx(
        {"y(k-1)": 0.8, "u(k)": 0.4, "y(k-1)^2": 0.1}
    )
    assert removal.error < 1e-13
    v = np.zeros(200)
    for k in range(1, 200):  # the law without its constant, given deviations
        v[k] = 0.6 * v[k - 1] + 0.4 * u[k] + 0.1 * v[k - 1] ** 2
    np.testing.assert_allclose(removal.deleted_run, 1 + v, atol=1e-13)
    assert removal.deleted_error == pytest.approx(np.sqrt(np.mean((1 + v - removal.run) ** 2)) / removal.run.std())
