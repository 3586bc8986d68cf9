"""H_1 against closed forms, differences, Monte Carlo and simulation."""

import numpy as np
import pytest

from deatwin.ident.frequency import FrequencyStatus, equilibrium, gfrf, remove_dc
from deatwin.ident.narx import NarxModel, OperatingRange
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

NONLINEAR = {"1": 0.1, "y(k-1)": 0.5, "y(k-2)^2": -0.2, "y(k-1)u(k-1)": 0.15, "u(k-1)": 0.4, "u(k-2)^3": 0.1}
SAMPLE_TIME = 0.02
OMEGA = 2 * np.pi * np.geomspace(0.1, 25.0, 40)


def nonlinear(theta=None, cov=None, operating=None):
    values = NONLINEAR.values() if theta is None else theta
    return NarxModel.from_terms(
        dict(zip(NONLINEAR, values, strict=True)),
        sample_time=SAMPLE_TIME,
        theta_cov=cov,
        operating=operating,
        input_units=("V",),
        output_units=("m",),
    )


def test_linear_model_gives_b_over_a():
    model = NarxModel.from_terms(
        {"y(k-1)": 1.1, "y(k-3)": -0.2, "u(k)": 0.3, "u(k-2)": -0.7}, sample_time=SAMPLE_TIME
    )
    q = np.exp(-1j * OMEGA * SAMPLE_TIME)
    response = gfrf(model, 1, OMEGA)
    np.testing.assert_allclose(response.values, (0.3 - 0.7 * q**2) / (1 - 1.1 * q + 0.2 * q**3), rtol=1e-12)
    np.testing.assert_allclose(response.frequency_Hz, OMEGA / (2 * np.pi))
    assert response.status is FrequencyStatus.OK
    np.testing.assert_array_equal(response.covariance, 0.0)


def test_it_equals_the_transfer_function_of_python_control():
    control = pytest.importorskip("control")
    model = NarxModel.from_terms(
        {"y(k-1)": 1.1, "y(k-2)": -0.3, "u(k-1)": 0.3, "u(k-2)": -0.7}, sample_time=SAMPLE_TIME
    )
    plant = control.tf([0.3, -0.7], [1, -1.1, 0.3], SAMPLE_TIME)
    np.testing.assert_allclose(
        gfrf(model, 1, OMEGA[:-1]).values, plant(np.exp(1j * OMEGA[:-1] * SAMPLE_TIME)), rtol=1e-12
    )


def test_at_zero_frequency_it_is_the_slope_of_the_equilibria():
    step = 1e-5
    slope = (equilibrium(nonlinear(), 0.7 + step).output - equilibrium(nonlinear(), 0.7 - step).output) / (
        2 * step
    )
    assert gfrf(nonlinear(), 1, 0.0, operating_input=0.7).values[0] == pytest.approx(slope, rel=1e-8)


def test_removing_the_operating_point_first_changes_nothing():
    root = 0.01 * np.random.default_rng(0).normal(size=(6, 6))
    model = nonlinear(cov=root @ root.T)
    direct, shifted = gfrf(model, 1, OMEGA, operating_input=0.7), gfrf(remove_dc(model, 0.7), 1, OMEGA)
    np.testing.assert_allclose(shifted.values, direct.values, rtol=1e-12)
    np.testing.assert_allclose(shifted.covariance, direct.covariance, rtol=1e-9, atol=1e-15)


def test_gradient_against_differences():
    response = gfrf(nonlinear(), 1, OMEGA, operating_input=0.7)
    theta = np.array(list(NONLINEAR.values()))
    for m, step in enumerate(1e-5 * np.eye(theta.size)):
        differences = (
            gfrf(nonlinear(theta + step), 1, OMEGA, operating_input=0.7).values
            - gfrf(nonlinear(theta - step), 1, OMEGA, operating_input=0.7).values
        ) / 2e-5
        np.testing.assert_allclose(response.gradient[:, m], differences, rtol=1e-6, atol=1e-8)


def test_covariance_against_monte_carlo():
    """4000 draws: a variance is known to 2.2 %, so 12 % is beyond five standard deviations."""
    rng = np.random.default_rng(1)
    root = 2e-3 * rng.normal(size=(6, 6))
    omega = OMEGA[::8]
    response = gfrf(nonlinear(cov=root @ root.T), 1, omega, operating_input=0.7)
    theta = np.array(list(NONLINEAR.values()))
    trained = OperatingRange(
        input_min=[0.5],
        input_max=[0.9],
        input_centre=[0.7],
        output_min=[0.5],
        output_max=[0.9],
        output_centre=[response.point.output],
    )
    draws = np.array(
        [
            gfrf(nonlinear(theta + root @ rng.normal(size=6), operating=trained), 1, omega).values
            for _ in range(4000)
        ]
    )
    for i in range(omega.size):
        sampled = np.cov(draws[:, i].real, draws[:, i].imag)
        size = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
        np.testing.assert_allclose(response.covariance[i] / size, sampled / size, atol=0.12)
    band = response.band(0.95)
    assert band.linear_law.all()
    inside = np.mean((np.abs(draws) > band.low) & (np.abs(draws) < band.high), axis=0)
    assert np.all(np.abs(inside - 0.95) < 0.02)


@pytest.mark.parametrize("cycles", [5, 40, 150])
def test_a_small_sinusoid_about_the_operating_point_is_answered_with_h1(cycles):
    n, amplitude = 1000, 1e-4
    model = nonlinear()
    ybar = equilibrium(model, 0.7).output
    phase = 2 * np.pi * cycles * np.arange(4 * n) / n
    run = model.simulate(
        Recording.from_arrays(0.7 + amplitude * np.cos(phase), np.full(4 * n, ybar), SAMPLE_TIME)
    )
    measured = 2 * np.mean(run.outputs[0, -n:] * np.exp(-1j * phase[-n:])) / amplitude
    expected = gfrf(model, 1, 2 * np.pi * cycles / (n * SAMPLE_TIME), operating_input=0.7).values[0]
    assert abs(measured - expected) < 1e-6 * abs(expected)


def test_band_says_where_the_linear_law_fails():
    """A zero at half the sampling rate: the gain there is 0, its uncertainty is not."""
    model = NarxModel.from_terms({"u(k)": 1.0, "u(k-1)": 1.0}, sample_time=1.0, theta_cov=1e-4 * np.eye(2))
    response = gfrf(model, 1, [0.1, np.pi])
    band = response.band(0.9)
    np.testing.assert_allclose(response.covariance[1, 0, 0], 2e-4, rtol=1e-9)
    np.testing.assert_array_equal(band.linear_law, [True, False])
    assert band.low[1] < 1e-12
    with pytest.raises(ModelError, match="level"):
        gfrf(model, 1, 0.1).band(95)


def test_an_unstable_operating_point_is_a_status():
    model = NarxModel.from_terms({"y(k-1)": 1.2, "u(k-1)": 1.0}, sample_time=1.0)
    assert not gfrf(model, 1, 0.1).status.ok


def test_what_is_not_there_is_said():
    with pytest.raises(ModelError, match=r"order 2 needs \(n, 2\)"):
        gfrf(nonlinear(), 2, OMEGA)
    with pytest.raises(ModelError, match="order = 0"):
        gfrf(nonlinear(), 0, OMEGA)
    with pytest.raises(ModelError, match="symmetric"):
        gfrf(nonlinear(), 1, OMEGA, form="symetric")
    with pytest.raises(ModelError, match="half the sampling rate"):
        gfrf(nonlinear(), 1, 1000.0)
    with pytest.raises(ModelError, match="one input"):
        gfrf(NarxModel.from_terms({"u1(k)": 1.0, "u2(k)": 1.0}, sample_time=1.0), 1, 0.1)


def test_plot_has_units_and_labels():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    axes = gfrf(nonlinear(cov=1e-6 * np.eye(6)), 1, OMEGA).plot()
    assert axes.get_xlabel() == "frequency (Hz)" and axes.get_ylabel() == "gain (m/V)"
    assert "95 % band" in [text.get_text() for text in axes.get_legend().get_texts()]
    pyplot.close("all")
