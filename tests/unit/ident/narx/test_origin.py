"""Signals that are far from zero: the model counts from an origin, and everything that takes it is right about it.

The reference is the same experiment without its offsets, or the raw polynomial where that still has its digits.
"""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.frequency import equilibrium, gfrf, hold_equilibrium, linear_part, remove_dc
from deatwin.ident.narx import Fixed, Frols, Lasso, Narmax, NarxModel, Semp, SvbNarx, ThetaSmoother, refine
from deatwin.ident.narx.posterior import free_run_band, one_step_band
from deatwin.ident.narx.robust import robust
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

U0, Y0 = 40.0, 300.0


def signals(n=600, seed=0):
    """y(k) = 0.6 y(k-1) + 0.5 u(k-1) + 0.3 u(k-2) + 0.1 u(k-1) u(k-2), seen with noise of 1 %."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, n), np.zeros(n)
    for k in range(2, n):
        y[k] = 0.6 * y[k - 1] + 0.5 * u[k - 1] + 0.3 * u[k - 2] + 0.1 * u[k - 1] * u[k - 2]
    return u, y + 0.005 * rng.standard_normal(n)


def moved(u, y, input_offset=0.0, output_offset=0.0, units=(1.0, 1.0)):
    return Recording.from_arrays(units[0] * (u + input_offset), units[1] * (y + output_offset), 1.0)


@pytest.mark.parametrize("swings", [(0.0, 3.0), (0.0, 1e5), (3.0, 0.0), (1e5, 0.0), (1e2, 1e2)])
def test_terms_and_free_run_do_not_depend_on_the_offsets(swings):
    """The inputs' mean over a record is not quite zero: what is at rest there is not at the output's zero either."""
    u, y = signals(seed=1)
    plain, about = moved(u, y), moved(u, y, swings[0] * np.ptp(u), swings[1] * np.ptp(y))
    reference, svb = SvbNarx().fit(plain), SvbNarx().fit(about)
    run = svb.model_.simulate(about)
    assert run.status.ok and svb.notes_ == () and svb.terms_ == reference.terms_
    assert run.rms_error == pytest.approx(reference.model_.simulate(plain).rms_error, rel=0.01)
    assert run.rms_error < 0.02 * y.std()


@pytest.mark.parametrize("identifier", [Frols(degree=3), Lasso(degree=2), Semp(degree=2), SvbNarx(degree=3)])
@pytest.mark.parametrize("swing", [1e-4, 1e-9])
def test_every_choice_of_terms_stands_a_swing_that_is_a_small_share_of_the_offset(identifier, swing):
    """The terms of the plant in its own signals, and a constant at most; a billionth leaves noise of rounding of 1e-7."""
    u, y = signals()
    near, far = moved(u, y, 10.0, 10.0), Recording.from_arrays(1.0 + swing * u, 1.0 + swing * y, 1.0)
    terms = identifier.fit(near).terms_
    error = identifier.model_.simulate(near).rms_error
    assert set(identifier.fit(moved(u, y)).terms_) == set(terms) == set(identifier.fit(far).terms_)
    assert identifier.model_.simulate(far).rms_error == pytest.approx(swing * error, rel=1e-3)
    assert {str(term) for term in terms} >= {"y(k-1)", "u(k-1)", "u(k-2)", "u(k-1)u(k-2)"}
    assert error < 1.05 * 0.005


def test_exact_data_about_an_offset_have_no_constant_and_no_wild_percentage():
    """Without noise the plant is known to rounding; what the prior still holds back is told in deviations of the output."""
    rng = np.random.default_rng(60)
    u, y = rng.uniform(-1, 1, 60), np.zeros(60)
    for k in range(2, 60):
        y[k] = 0.6 * y[k - 1] + 0.5 * u[k - 1] + 0.3 * u[k - 2] + 0.1 * u[k - 1] * u[k - 2]
    svb = SvbNarx().fit(moved(u, y, 0.0, Y0))
    assert {str(term) for term in svb.terms_} == {"y(k-1)", "u(k-1)", "u(k-2)", "u(k-1)u(k-2)"}
    assert all("%" not in note and "only rounding" in note for note in svb.notes_)


def test_with_offsets_the_outputs_rest_together_without_a_constant():
    """Two coupled outputs, driven off their rest by the square of the input; the model at offset zero has no constant."""
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 800), np.zeros((2, 800))
    for k in range(1, 800):
        y[0, k] = 0.6 * y[0, k - 1] + 0.5 * u[k - 1] + 0.3 * u[k - 1] ** 2
        y[1, k] = 0.4 * y[1, k - 1] - 0.3 * u[k - 1] + 0.2 * y[0, k - 1] + 0.1 * y[0, k - 1] ** 2
    seen = y + 0.002 * rng.standard_normal(y.shape)
    offsets = np.array([[40.0], [-300.0]])
    svb = SvbNarx().fit(Recording.from_arrays(u + 20.0, seen + offsets, 1.0))
    assert all(term.degree > 0 for term in svb.model_.terms)
    free = svb.model_.simulate(Recording.from_arrays(u + 20.0, y + offsets, 1.0)).outputs - offsets
    assert np.all((free - y).std(axis=1) < 0.005 * y.std(axis=1))
    np.testing.assert_allclose(svb.model_.output_origin, offsets[:, 0], atol=0.05)


def test_a_signal_that_reaches_zero_counts_from_zero():
    u, y = signals()
    model = SvbNarx().fit(moved(0.5 + 0.5 * u, y)).model_  # 0 to 1
    assert model.input_origin.tolist() == model.output_origin.tolist() == [0.0]
    assert "where" not in str(model)


def test_slightly_damped_poles_and_nearly_collinear_lags():
    """Two modes at low frequencies: least squares on the same terms is the reference."""
    rng, radius = np.random.default_rng(4), 0.999
    poles = [radius * np.exp(1j * angle * sign) for angle in (0.2, 0.35) for sign in (1, -1)]
    a, n = np.poly(poles).real, 800
    u, y = np.cumsum(rng.standard_normal(n)) * 0.1, np.zeros(n)
    for k in range(4, n):
        y[k] = -a[1:] @ y[k - 4 : k][::-1] + 0.1 * u[k - 1]
    y = y + 1e-4 * y.std() * rng.standard_normal(n)
    recording = Recording.from_arrays(u, y, 1.0)
    lags = {"output_lags": 5, "input_lags": 5, "degree": 1}
    svb = SvbNarx(**lags).fit(recording)
    least = Fixed(terms=svb.model_).fit(recording).model_
    assert svb.notes_ == () and svb.settled_
    assert svb.model_.predict(recording).rms_error <= 1.01 * least.predict(recording).rms_error
    run, reference = svb.model_.simulate(recording), least.simulate(recording)
    assert run.status is reference.status
    assert run.rms_error <= 1.5 * reference.rms_error


def test_a_fit_that_is_worse_than_least_squares_says_so():
    from deatwin.ident.narx import Ridge

    u, y = signals()
    held = Fixed(terms=["y(k-1)", "u(k-1)", "u(k-2)"], estimator=Ridge(penalty=1.0)).fit(moved(u, y))
    assert len(held.notes_) == 1 and "least squares" in held.notes_[0]
    assert Fixed(terms=["y(k-1)", "u(k-1)", "u(k-2)"]).fit(moved(u, y)).notes_ == ()
    assert Frols().fit(moved(u, y)).notes_ == ()
    early = SvbNarx(max_iterations=1).fit(moved(u, y))
    assert not early.settled_ and any("max_iterations" in note for note in early.notes_)


def test_noise_models_and_several_outputs_about_an_origin():
    u, y = signals()
    plain, far = Narmax(SvbNarx()).fit(moved(u, y)), Narmax(SvbNarx()).fit(moved(u, y, 0.0, 1e3))
    deterministic = [fit.model_.deterministic for fit in (plain, far)]
    assert deterministic[0].terms == deterministic[1].terms
    np.testing.assert_allclose(deterministic[0].theta, deterministic[1].theta, rtol=0.02)
    both = np.stack([y, 2 * y + 0.1 * np.append(0.0, u[:-1])])
    several = SvbNarx(degree=1).fit(Recording.from_arrays(u, both + np.array([[1e4], [0.0]]), 1.0))
    assert several.model_.output_origin[0] > 9e3 and several.model_.output_origin[1] == 0.0
    reference = SvbNarx(degree=1).fit(Recording.from_arrays(u, both, 1.0))
    recording = Recording.from_arrays(u, both + np.array([[1e4], [0.0]]), 1.0)
    assert several.model_.predict(recording).rms_error == pytest.approx(
        reference.model_.predict(Recording.from_arrays(u, both, 1.0)).rms_error, rel=0.01
    )


# ---- consumers: a model about an origin equals the raw polynomial written out, which at this swing has its digits

TERMS = {"1": 0.2, "y(k-1)": 0.5, "u(k-1)": 0.4, "u(k-1)^2": 0.2, "y(k-1)u(k-2)": -0.1}
COV = np.diag([1e-4, 4e-4, 1e-4, 1e-4, 1e-4])


def about_origin():
    return NarxModel.from_terms(
        TERMS, sample_time=1.0, theta_cov=COV, noise_variance=1e-4, input_origin=[U0], output_origin=[Y0]
    )


def jacobian():
    """Of the raw parameters (1, y1, u1, u2, u1^2, y1 u2) by those about the origin: (y - Y0)(u - U0) and so on."""
    return np.array(
        [
            [1, -Y0, -U0, U0**2, Y0 * U0],
            [0, 1, 0, 0, -U0],
            [0, 0, 1, -2 * U0, 0],
            [0, 0, 0, 0, -Y0],
            [0, 0, 0, 1, 0],
            [0, 0, 0, 0, 1],
        ]
    )


def raw():
    theta = jacobian() @ np.array(list(TERMS.values()))
    theta[0] += Y0
    terms = dict(zip(["1", "y(k-1)", "u(k-1)", "u(k-2)", "u(k-1)^2", "y(k-1)u(k-2)"], theta, strict=True))
    covariance = jacobian() @ COV @ jacobian().T
    return NarxModel.from_terms(terms, sample_time=1.0, theta_cov=covariance, noise_variance=1e-4)


def experiment(n=200):
    rng = np.random.default_rng(2)
    u = U0 + rng.uniform(-1, 1, n)
    run = raw().simulate(Recording.from_arrays(u, np.full(n, Y0), 1.0))
    return Recording.from_arrays(u, run.outputs + 0.01 * rng.standard_normal((1, n)), 1.0)


def test_it_predicts_and_runs_free_as_the_raw_polynomial():
    recording = experiment()
    for method in ("predict", "simulate"):
        found, expected = getattr(about_origin(), method)(recording), getattr(raw(), method)(recording)
        np.testing.assert_allclose(found.outputs, expected.outputs, rtol=0, atol=1e-9)
    assert np.array_equal(found.outputs[:, :2], recording.outputs[:, :2])


def test_without_outputs_it_starts_from_its_origin():
    run = about_origin().simulate(np.full(50, U0))
    given = about_origin().simulate(np.full(50, U0), initial=[Y0, Y0])
    np.testing.assert_allclose(run.outputs, given.outputs)


def test_its_bands_are_those_of_the_raw_polynomial():
    recording = experiment()
    found, expected = one_step_band(about_origin(), recording), one_step_band(raw(), recording)
    np.testing.assert_allclose(found.upper, expected.upper, rtol=0, atol=1e-7)
    wide = free_run_band(about_origin(), recording, np.random.default_rng(0), n_draws=200)
    np.testing.assert_allclose(wide.outputs, raw().simulate(recording).outputs, atol=0.15)


def test_its_equilibrium_gains_and_responses_are_those_of_the_raw_polynomial():
    point = equilibrium(about_origin(), U0 + 0.3)
    assert point.output == pytest.approx(equilibrium(raw(), U0 + 0.3).output, abs=1e-9)
    for at in (None, U0 + 0.3):
        level = U0 if at is None else at
        rest = equilibrium(about_origin(), level).output
        found, expected = (linear_part(m, level, rest) for m in (about_origin(), raw()))
        assert found.b.sum() / (1 - found.a.sum()) == pytest.approx(expected.b.sum() / (1 - expected.a.sum()))
    deviations, reference = remove_dc(about_origin(), U0 + 0.3), remove_dc(raw(), U0 + 0.3)
    assert deviations.terms == reference.terms
    np.testing.assert_allclose(deviations.theta, reference.theta, atol=1e-9)
    np.testing.assert_allclose(deviations.theta_cov, reference.theta_cov, atol=1e-7)
    assert not deviations.output_origin.any() and not deviations.input_origin.any()
    for order in (1, 2):
        tones = np.full((1, order), 0.1)
        found, expected = (gfrf(m, order, tones, operating_input=U0 + 0.3) for m in (about_origin(), raw()))
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-7)


def test_its_linear_models_are_those_of_the_raw_polynomial():
    from deatwin.control import linearise
    from deatwin.control.linear.family import linearise_many

    found, expected = (linearise(m, U0 + 0.3) for m in (about_origin(), raw()))
    assert found.operating_output == pytest.approx(expected.operating_output)
    np.testing.assert_allclose(found.denominator, expected.denominator, atol=1e-9)
    np.testing.assert_allclose(found.numerator, expected.numerator, atol=1e-9)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-7)
    rng = np.random.default_rng(1)
    thetas = about_origin().theta + 0.01 * rng.standard_normal((20, 5))
    others = thetas @ jacobian().T + np.array([Y0, 0, 0, 0, 0, 0])
    found, expected = linearise_many(about_origin(), [U0 + 0.3], thetas), linearise_many(raw(), [U0 + 0.3], others)
    assert found.exists.all()
    np.testing.assert_allclose(found.numerators, expected.numerators, atol=1e-9)
    np.testing.assert_allclose(found.operating_outputs, expected.operating_outputs, atol=1e-7)


def test_python_control_runs_it_as_it_runs_free():
    from deatwin.control.interop.narx_system import NarxSystem

    recording, system = experiment(), NarxSystem(model=about_origin())
    state, expected = system.past(recording.inputs[:, :2], recording.outputs[:, :2]), about_origin().simulate(recording)
    outputs = []
    for k in range(2, recording.n_samples):
        outputs.append(system.output(float(k), state, recording.inputs[:, k], {}))
        state = system.update(float(k), state, recording.inputs[:, k], {})
    np.testing.assert_allclose(np.array(outputs).T, expected.outputs[:, 2:], rtol=0, atol=1e-9)


def test_refits_keep_the_origin():
    recording = experiment(600)
    fixed = Fixed(terms=about_origin())
    for estimator in (fixed, ThetaSmoother(terms=about_origin()), Narmax(fixed)):
        model = estimator.fit(recording).model_
        assert model.output_origin.tolist() == [Y0] and model.input_origin.tolist() == [U0]
        assert model.predict(recording).rms_error < 0.012
    start = replace(about_origin(), theta=about_origin().theta * 1.02)
    refined = refine(start, recording)
    assert refined.simulate(recording).rms_error <= start.simulate(recording).rms_error
    assert robust(refined, recording).theta_cov.shape == (5, 5)
    smoothed = ThetaSmoother(terms=about_origin()).fit(recording).trajectory_
    assert smoothed.predict(recording).rms_error < 0.012
    held = hold_equilibrium(smoothed, Y0 + 0.1, U0)
    assert equilibrium(held.at(held.timepts[50]), U0).output == pytest.approx(Y0 + 0.1)


def test_it_is_printed_with_its_origin():
    assert str(about_origin()).endswith("\nwhere y is output less 300, u is input less 40")
    with pytest.raises(ModelError, match=r"input_origin must be 1 finite number"):
        NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=1.0, input_origin=[1.0, 2.0])


def test_a_named_signal_is_written_as_in_the_terms() -> None:
    model = NarxModel.from_terms(
        {"y(k-1)": 0.5, "u(k-1)": 2.0},
        sample_time=1.0,
        output_names=("T",),
        output_units=("K",),
        input_names=("heater power",),
        input_units=("1",),
        output_origin=np.array([300.0]),
        input_origin=np.array([40.0]),
    )
    assert str(model).splitlines()[1] == "where T counts from 300 K, u is heater power less 40"
