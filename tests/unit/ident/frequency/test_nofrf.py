"""NOFRFs by least squares against sums over GFRFs, free runs, theory of the truncation, and hostile inputs."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from direct import direct_output
from made_narx import trained_on
from slopes import differences

from deatwin.ident.frequency import propagate
from deatwin.ident.frequency.output_responses.estimate import nofrf, nofrf_exact
from deatwin.ident.frequency.output_responses.excitation import design_excitation
from deatwin.ident.frequency.output_responses.result import NofrfStatus, NofrfWarning
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.recording import Recording

SAMPLE_TIME = 0.02
# linear in the output: of the degree of the input terms, and no higher
FINITE = {
    "degree 2": {"y(k-1)": 1.2, "y(k-2)": -0.5, "u(k-1)": 0.4, "u(k-1)u(k-3)": -0.2, "u(k-2)^2": 0.3},
    "degree 3": {"y(k-1)": 0.8, "u(k-1)": 0.4, "u(k-1)^2": 0.4, "u(k-2)^2u(k-4)": 0.15, "u(k-1)^3": 0.4},
    "odd": {"y(k-1)": 0.5, "y(k-2)": -0.3, "u(k-1)": 0.5, "u(k-1)^3": -0.4},
}
INFINITE = {
    "quadratic": {"y(k-1)": 0.6, "u(k-1)": 0.4, "y(k-1)^2": 0.2, "y(k-2)u(k-1)": -0.1},
    "cubic": {"y(k-1)": 1.3, "y(k-2)": -0.6, "u(k-1)": 0.2, "y(k-1)^3": -0.1, "y(k-1)^2": 0.15},
}
RESONANT = {  # at 3.5 Hz
    "y(k-1)": 1.5,
    "y(k-2)": -0.7,
    "u(k-1)": 0.15,
    "u(k-1)^2": 0.08,
    "y(k-1)^2": -0.05,
    "y(k-1)u(k-1)^2": 0.1,
}
TWO_INPUTS = NarxModel.from_terms({"y(k-1)": 0.5, "u1(k-1)": 1.0, "u2(k-1)": 1.0}, sample_time=SAMPLE_TIME)


def model_of(terms, **details):
    return NarxModel.from_terms(terms, sample_time=SAMPLE_TIME, input_units=("V",), output_units=("mm",), **details)


def signal(amplitude=0.5, band=(1.0, 4.0), period=4.0):
    return design_excitation(band, SAMPLE_TIME, amplitude=amplitude, period=period)


def simulated_spectrum(model, period, n_periods=40):
    """Fourier coefficients of the last of many periods of a free run from rest."""
    inputs = np.tile(period, n_periods)
    run = model.simulate(Recording.from_arrays(inputs, np.zeros(inputs.size), SAMPLE_TIME))
    assert run.status.ok
    return np.fft.rfft(run.outputs[0, -period.size :]) / period.size


def relative(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize("name", FINITE)
def test_least_squares_equal_the_sum_over_gfrfs(name):
    model, excitation = model_of(FINITE[name]), signal()
    found = nofrf(model, excitation, 3, highest=3)
    assert found.status.ok
    for n, (response, spectrum) in enumerate(zip(found.orders, found.inputs, strict=True), start=1):
        direct = direct_output(model, excitation, n).values[spectrum.defined] / spectrum.values[spectrum.defined]
        # the tolerance is 1e-6; rounding of the output at its lines by |U_n| at the edge of its range: 1e-10
        assert np.abs(response.values - direct).max() <= 1e-9 * max(np.abs(direct).max(), 1e-3)
        np.testing.assert_allclose(nofrf_exact(model, excitation, n).values, direct, atol=1e-9, rtol=1e-9)
        np.testing.assert_array_equal(response.omega, spectrum.omega[spectrum.defined])
    np.testing.assert_array_equal(found.values, found.orders[2].values)


@pytest.mark.parametrize("name", FINITE)
def test_the_sum_of_orders_is_the_simulated_spectrum(name):
    model, excitation = model_of(FINITE[name]), signal()
    found = nofrf(model, excitation, 3)
    for level in (1.0, -0.37):  # the second is not among the levels that were fitted
        simulated = simulated_spectrum(model, level * excitation.values)
        assert relative(sum(level**y.order * y.values for y in found.outputs), simulated) <= 1e-12


@pytest.mark.parametrize("name", INFINITE)
def test_the_truncation_error_is_known(name):
    model, excitation = model_of(INFINITE[name]), signal(0.1)
    found = nofrf(model, excitation, 3, highest=5)
    for n in (1, 2, 3):
        bias = np.abs(found.orders[n - 1].values - nofrf_exact(model, excitation, n).values)
        # to leading order: the two orders after the two that were added change it by their share
        np.testing.assert_allclose(found.truncation[n - 1], bias, rtol=0.3, atol=1e-3 * bias.max() + 1e-11)


def roughness(response):
    """Second differences of the log gain from line to line, root mean square: bends, not slopes."""
    return np.sqrt(np.mean(np.diff(np.log(response.gain), 2) ** 2))


def test_a_random_record_is_warned_of_and_erratic_and_the_designed_signal_is_not():
    # 10 of 10 seeds; G_1 is the same for both, since a single line cannot cancel
    model = model_of(RESONANT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        designed = nofrf(model, signal(0.3, band=(0.0, 5.0), period=8.0), 3)
    assert designed.status is NofrfStatus.OK
    for seed in range(10):
        record = band_limited_noise(
            np.random.default_rng(seed), 8.0, SAMPLE_TIME, variance=0.004, mean=0.0, band=5.0, lower=-1.0, upper=1.0
        )
        with pytest.warns(NofrfWarning, match="random recordings are unsuitable"):
            erratic = nofrf(model, record, 3)
        assert erratic.status is NofrfStatus.ERRATIC_EXCITATION
        for n in (2, 3):
            assert roughness(erratic.orders[n - 1]) > 5 * roughness(designed.orders[n - 1])
        np.testing.assert_allclose(erratic.orders[0].values, designed.orders[0].values[1:41], rtol=1e-4)


@pytest.mark.parametrize(("name", "order", "supported"), [("degree 2", 1, 2), ("degree 3", 1, 3), ("odd", 2, 3)])
def test_the_order_that_the_output_supports_is_found(name, order, supported):
    found = nofrf(model_of(FINITE[name]), signal(), order)
    assert found.highest == supported
    assert found.left_out[supported - 1] < 1e-12 < 1e-3 < found.left_out[supported - 2]
    assert found.residual.shape == (found.levels.size, supported)
    assert found.residual[:, -1].max() < 1e-12


def test_levels_are_chebyshev_and_their_condition_is_reported():
    found = nofrf(model_of(FINITE["degree 3"]), signal(), 3, highest=3)
    nodes = np.cos((2 * np.arange(6) + 1) * np.pi / 12)
    np.testing.assert_allclose(found.levels, nodes / nodes[0], rtol=1e-12)
    powers = found.levels[:, None] ** [1, 2, 3]
    assert found.condition == pytest.approx(np.linalg.cond(powers / np.linalg.norm(powers, axis=0)))


def test_derivatives_are_those_of_the_fit():
    theta = np.array(list(FINITE["degree 3"].values()))
    model = model_of(FINITE["degree 3"], theta_cov=np.diag((0.01 * theta) ** 2))
    excitation = signal()
    found = nofrf(model, excitation, 3, highest=3)
    for n in range(3):
        slopes = differences(
            lambda t, n=n: nofrf(replace(model, theta=t), excitation, 3, highest=3).orders[n].values, theta, 1e-5
        )
        np.testing.assert_allclose(found.orders[n].gradient, slopes, atol=1e-6 * np.abs(slopes).max())
    parts = np.stack([found.response.gradient.real, found.response.gradient.imag], axis=1)
    np.testing.assert_allclose(
        found.response.covariance[:, 0, 1], np.einsum("nm,mk,nk->n", parts[:, 0], model.theta_cov, parts[:, 1])
    )


def test_the_highest_number_of_orders_is_fitted():
    # with Chebyshev levels 20 orders and the two that judge them stay below the limit of the condition
    found = nofrf(model_of(FINITE["degree 2"]), signal(), 2, highest=20)
    assert found.status is NofrfStatus.OK
    np.testing.assert_allclose(found.values, nofrf_exact(model_of(FINITE["degree 2"]), signal(), 2).values, rtol=1e-5)


def test_a_fit_is_propagated_as_the_exact_orders_are_and_fitted_once():
    # it departs from its tangent as the exact order does; its truncation error does not count as such a departure
    model = model_of(INFINITE["quadratic"], theta_cov=1e-6 * np.eye(4))
    with pytest.warns(NofrfWarning) as caught:
        fitted = propagate(model, lambda m: nofrf(m, signal(0.3), 2, highest=2).response)
    assert len(caught) == 1
    exact = propagate(model, partial(nofrf_exact, excitation=signal(0.3), order=2))
    assert np.abs(fitted.values - exact.values).max() > 1e-3 * np.abs(exact.values).max()
    np.testing.assert_allclose(fitted.nonlinearity, exact.nonlinearity, rtol=1e-6)


def test_about_an_operating_point():
    terms = {"1": 0.1, "y(k-1)": 0.5, "u(k-1)": 0.4, "u(k-1)^2": 0.2, "u(k-2)^3": 0.1}
    limits = trained_on((0.0, 2.0), (0.0, 5.0), input_centre=1.2, output_centre=2.0)
    model = model_of(terms, operating=limits)
    excitation = design_excitation((1.0, 4.0), SAMPLE_TIME, operating=limits, period=4.0)
    assert excitation.amplitude == pytest.approx(0.8)
    for point, given in ((1.2, None), (0.4, 0.4)):
        found = nofrf(model, excitation, 3, operating_input=given)
        # y = 0.5 y + f(u): about u0 the static gains are f'(u0), f''(u0)/2, f'''/6, by the linear filter
        q = np.exp(-1j * found.orders[0].omega * SAMPLE_TIME)
        linear = (q * (0.4 + 0.4 * point) + q**2 * 0.3 * point**2) / (1 - 0.5 * q)
        np.testing.assert_allclose(found.orders[0].values, linear, rtol=1e-9)


def test_a_slow_model_settles_and_a_slower_one_is_said_not_to():
    excitation = signal(0.2, period=4.0)
    slow = model_of({"y(k-1)": 0.9999, "u(k-1)": 1e-2, "u(k-1)^2": 1e-2})
    found = nofrf(slow, excitation, 2, highest=2)
    assert found.status is NofrfStatus.OK
    np.testing.assert_allclose(found.values, nofrf_exact(slow, excitation, 2).values, rtol=1e-6)
    slower = model_of({"y(k-1)": 1 - 1e-8, "u(k-1)": 1e-2, "u(k-1)^2": 1e-2})
    with pytest.warns(NofrfWarning, match="does not repeat"):
        found = nofrf(slower, excitation, 1, highest=2)
    assert found.status is NofrfStatus.NOT_SETTLED


def test_divergence_names_the_levels():
    # y = 0.5 y + u + 0.2 y^2 has no equilibrium beyond u = 0.3125, where (1 - 0.5)^2 = 4 0.2 u
    model = model_of({"y(k-1)": 0.5, "u(k-1)": 1.0, "y(k-1)^2": 0.2})
    held = design_excitation((0.0, 0.05), SAMPLE_TIME, amplitude=0.33)
    with pytest.warns(NofrfWarning, match=r"model diverges .* \(1 times the excitation\)"):
        found = nofrf(model, held, 2)
    assert found.status is NofrfStatus.DIVERGED
    np.testing.assert_array_equal(found.lost_levels, [1.0])
    assert 1.0 not in found.levels
    with pytest.raises(ModelError, match="lower the amplitude"):
        nofrf(model, 1000 * held.values, 2)


def test_an_unstable_point_is_said():
    model = model_of({"y(k-1)": 1.1, "y(k-1)^3": -0.1, "u(k-1)": 0.01})
    with pytest.warns(NofrfWarning, match="operating point is unstable"):
        assert nofrf(model, signal(), 1).status is NofrfStatus.UNSTABLE


def test_orders_that_act_and_were_not_fitted_are_said_and_the_level_that_would_do():
    model = model_of(INFINITE["quadratic"])
    with pytest.warns(NofrfWarning, match="were not fitted"):
        found = nofrf(model, signal(0.3), 3, highest=3)
    assert found.status is NofrfStatus.TRUNCATED
    assert 0.0 < found.advisable_level < 1.0
    better = nofrf(model, signal(0.3 * 0.9 * found.advisable_level), 3, highest=3)
    assert better.status is NofrfStatus.OK
    assert better.advisable_level == 1.0


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"highest": 2}, "highest = 2; it must be an integer of at least 3"),
        ({"highest": 500}, "500 orders; beyond 20 the powers of the levels can hardly be distinguished"),
        ({"order": 21}, "21 orders; beyond 20"),
        ({"excitation": 1e200 * signal().values}, "power 2 of an excitation up to 5e.199 leaves the range"),
        ({"order": 0}, "order = 0"),
        ({"excitation": [1.0]}, "shape"),
        ({"excitation": design_excitation((0.0, 1.0), 0.1, amplitude=1.0)}, "sample time of 0.1 s"),
        ({"model": TWO_INPUTS}, "2 inputs"),
    ],
)
def test_what_cannot_be_is_said(given, text):
    usual = {"model": model_of(FINITE["degree 2"]), "excitation": signal(), "order": 3}
    with pytest.raises(ModelError, match=text):
        nofrf(**(usual | given))


def test_results_are_drawn_and_written():
    model = model_of(INFINITE["quadratic"], theta_cov=1e-4 * np.eye(4))
    found = nofrf(model, signal(0.2), 2)
    axes = found.plot_orders()
    assert [ax.get_ylabel() for ax in axes] == ["gain (mm/V)", "gain (mm/V$^2$)"]
    assert found.plot().get_xlabel() == "frequency (Hz)"
    written = found.to_xarray()
    assert written["real"].dims == ("order", "frequency")
    shown = written["real"].sel(order=2).dropna("frequency")
    np.testing.assert_array_equal(shown, found.values.real)
    np.testing.assert_allclose(shown.frequency, found.frequency_Hz)
    with pytest.raises(ModelError, match="as many axes"):
        found.plot_orders(axes[:1])
