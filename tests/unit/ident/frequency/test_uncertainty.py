"""Uncertainty of frequency responses: laws against closed forms, scipy and draws; what is said where they fail."""

import math
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_narx import trained_on
from scipy import stats

from deatwin.ident.frequency import gfrf, output_orders, output_spectrum
from deatwin.ident.frequency.uncertainty.beside_draws import (
    SampleStatus,
    Spread,
    departure,
    sample,
    spread_of,
    whitened,
)
from deatwin.ident.frequency.uncertainty.gain_phase import polar
from deatwin.ident.frequency.uncertainty.propagate import UncertaintyStatus, UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.regions import draw_theta, evaluate
from deatwin.ident.narx import NarxModel

SAMPLE_TIME = 0.02
OMEGA = 2 * np.pi * np.geomspace(0.1, 20.0, 9)
NONLINEAR = {"1": 0.1, "y(k-1)": 0.5, "y(k-2)^2": -0.2, "y(k-1)u(k-1)": 0.15, "u(k-1)": 0.4, "u(k-2)^3": 0.1}
PERIOD = np.cos(2 * np.pi * np.arange(16) * 2 / 16) + 0.5 * np.sin(2 * np.pi * np.arange(16) * 3 / 16)


def nonlinear(size=1e-3, dof=math.inf):
    root = size * np.random.default_rng(3).normal(size=(6, 6))
    model = NarxModel.from_terms(
        NONLINEAR, sample_time=SAMPLE_TIME, theta_cov=root @ root.T, input_units=("V",), output_units=("m",)
    )
    return replace(model, theta_dof=dof)


def fir(cov, dof=math.inf):
    """H = b_0 + b_1 q^-1, linear in its parameters: the first-order law is exact."""
    model = NarxModel.from_terms({"u(k)": 1.0, "u(k-1)": 0.6}, sample_time=1.0, theta_cov=np.asarray(cov))
    return replace(model, theta_dof=dof)


QUANTITIES = {
    "H_1": partial(gfrf, order=1, omega=OMEGA, operating_input=0.7),
    "H_2": partial(gfrf, order=2, omega=np.c_[OMEGA, OMEGA[::-1]], operating_input=0.7),
    "H_3": partial(gfrf, order=3, omega=np.c_[OMEGA, OMEGA, -OMEGA[::-1]], operating_input=0.7),
    "Y": partial(output_spectrum, excitation=PERIOD, order=3, operating_input=0.7),
    "Y_2": lambda model: output_orders(model, PERIOD, 2, operating_input=0.7)[1],
}


# The law of propagation


def test_gain_and_phase_against_differences_of_both():
    found = propagate(nonlinear(), QUANTITIES["H_1"])
    x, y, step = found.values.real, found.values.imag, 1e-6
    differences = [
        [(f(x + step, y) - f(x - step, y)) / (2 * step), (f(x, y + step) - f(x, y - step)) / (2 * step)]
        for f in (np.hypot, lambda real, imag: np.arctan2(imag, real))
    ]
    jacobian = np.moveaxis(np.array(differences), -1, 0)
    expected = jacobian @ found.covariance @ jacobian.swapaxes(1, 2)
    np.testing.assert_allclose(found.gain_phase_covariance, expected, rtol=1e-6, atol=1e-14)
    gain, phase = 1.959964 * np.sqrt([expected[:, 0, 0], expected[:, 1, 1]])
    np.testing.assert_allclose(found.gain_band().high - found.gain, gain, rtol=1e-5)
    np.testing.assert_allclose(found.phase_deg - found.phase_band().low, np.degrees(phase), rtol=1e-5)


def test_radius_of_the_ellipse_is_that_of_chi_square_and_of_f():
    for dof, squared in ((math.inf, stats.chi2(2).ppf(0.95)), (7.0, 2 * stats.f(2, 7).ppf(0.95) * 5 / 7)):
        found = propagate(fir([[1e-4, 2e-5], [2e-5, 3e-4]], dof), partial(gfrf, order=1, omega=[0.5, 1.0, 2.0]))
        away = found.ellipse(n_points=9) - found.values[:, None]
        for cov, outline in zip(found.covariance, away, strict=True):
            parts = np.stack([outline.real, outline.imag])
            np.testing.assert_allclose(np.sum(parts * np.linalg.solve(cov, parts), axis=0), squared, rtol=1e-9)
    assert found.contains(found.values + 0.999 * away[:, 3]).all()
    assert not found.contains(found.values + 1.001 * away[:, 3]).any()


def test_a_real_response_has_a_segment_of_one_dimension():
    """At zero frequency the imaginary part is 0 and certain: 1.96 standard deviations, not 2.45."""
    found = propagate(fir(1e-4 * np.eye(2)), partial(gfrf, order=1, omega=0.0))
    deviation = math.sqrt(2e-4)
    np.testing.assert_allclose(np.ptp(found.ellipse().real), 2 * 1.959964 * deviation, rtol=1e-6)
    assert found.contains(1.6 + 1.95 * deviation)[0] and not found.contains(1.6 + 1.97 * deviation)[0]
    assert found.status.ok


# Gain and phase where they are not normal


@pytest.mark.parametrize("value", [0.4 + 0.0j, 0.0j])
def test_the_gain_is_covered_where_the_truth_lies_along_the_short_axis(value):
    """Long, thin ellipses about values near zero, as of a model without gain at rest: at least 95 % of 400.

    Quantiles of the gain hold the truth in none of these cases where the value is on the short axis. The range over the
    ellipse holds it whenever the ellipse does; below 364 of 400 is less likely than 1e-3 by the binomial law.
    """
    rng = np.random.default_rng(5)
    root = np.diag([5.0, 0.2])
    response = partial(gfrf, order=1, omega=np.array([np.pi / 2]))  # 1 and q^-1 are real and imaginary there
    covered = 0
    for real, imaginary in (root @ rng.normal(size=(2, 400))).T:
        found = value + real + 1j * imaginary
        model = NarxModel.from_terms(
            {"u(k)": found.real, "u(k-1)": -found.imag}, sample_time=1.0, theta_cov=root @ root.T
        )
        band = propagate(model, response).gain_band()
        covered += band.low[0] - 1e-9 <= abs(value) <= band.high[0]
    assert covered >= 364


def test_bends_of_gain_and_phase_are_their_second_order_terms():
    """Against a million draws at 8 standard deviations, where third orders are small: within 5 %."""
    value, cov = 3.0 + 4.0j, np.array([[0.3, 0.1], [0.1, 0.2]]) * 0.4
    real, imag = np.linalg.cholesky(cov) @ np.random.default_rng(2).normal(size=(2, 1_000_000))
    direction = value / abs(value)
    turned = (real + 1j * imag) * np.conj(direction)
    left = np.abs(value + real + 1j * imag) - abs(value) - turned.real
    found = polar(np.array([value]), cov[None])
    assert found.gain_bend[0] == pytest.approx(np.sqrt(np.mean(left**2)) / turned.real.std(), rel=0.05)
    left = np.angle((value + real + 1j * imag) / value) - turned.imag / abs(value)
    assert found.phase_bend[0] == pytest.approx(np.sqrt(np.mean(left**2)) * abs(value) / turned.imag.std(), rel=0.05)


def near_zero(deviation):
    """1 + 0.8 q^-1 + 0 q^-2 + 0 q^-3: gains of 1.8, 0.29 at 2.9 rad, and 0.2 at half the rate, where it is real."""
    model = NarxModel.from_terms(
        {"u(k)": 1.0, "u(k-1)": 0.8, "u(k-2)": 0.0, "u(k-3)": 0.0}, sample_time=1.0, theta_cov=deviation**2 * np.eye(4)
    )
    return model, partial(gfrf, order=1, omega=np.array([0.1, 2.9, np.pi]))


def test_near_zero_gain_the_range_of_the_ellipse_is_used_and_it_is_said():
    """With a standard deviation of 0.14, the gain is 1.4 of these at the end: its sign is not known there."""
    model, quantity = near_zero(0.07)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = propagate(model, quantity)
    assert found.status is UncertaintyStatus.LOW_GAIN and found.linear_law.all()
    np.testing.assert_array_equal(found.contains(0.0), [False, False, True])
    np.testing.assert_array_equal(found.gain_band().linear_law, [True, False, False])
    np.testing.assert_array_equal(found.phase_band().linear_law, [True, False, False])
    assert "limit 0.25, above it at 2 of 3" in found.advice
    drawn = sample(model, quantity, np.random.default_rng(1), 100_000)
    gain, phase = np.abs(drawn.draws), np.degrees(np.angle(drawn.draws))
    for values, band in ((gain, found.gain_band()), (phase[:, :2], found.phase_band())):
        n = values.shape[1]
        inside = np.mean((values >= band.low[:n]) & (values <= band.high[:n]), axis=0)
        # four standard deviations of 100,000 draws; where the law is taken to hold, 0.3 % more for what it neglects
        assert inside[0] == pytest.approx(0.95, abs=0.006)
        assert np.all(inside[1:] >= 0.95 - 0.003)  # who is in the ellipse is in its range


def test_the_phase_is_undefined_where_the_ellipse_holds_zero():
    found = propagate(*near_zero(0.25))
    np.testing.assert_array_equal(found.contains(0.0), [False, True, True])
    band, gain = found.phase_band(), found.gain_band()
    np.testing.assert_array_equal(np.isnan(band.low), [False, True, True])
    np.testing.assert_array_equal(np.isnan(band.high), [False, True, True])
    np.testing.assert_array_equal(gain.low == 0.0, [False, True, True])
    # at half the sampling rate the response is real, N(0.2, 0.5²): its ellipse is an interval
    assert gain.high[2] == pytest.approx(0.2 + stats.norm.ppf(0.975) * 0.5, rel=1e-6)


# How far the law holds


def test_bands_of_a_response_that_one_parameter_moves_round_zero():
    # Where the only uncertain parameter moves the response across its value, its segment is long but stays away from 0:
    # H = z^-1 / (1 - p z^-1) moves by H^2, which is across H where H is imaginary.
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0, theta_cov=np.diag([0.25**2, 0.0]))
    omega = np.arccos(0.5) + np.array([-0.1, -0.03, 0.03, 0.1])  # about where 1 / H = z - 0.5 is imaginary
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)
        found = propagate(model, partial(gfrf, order=1, omega=omega))
    ends = found.values[:, None] + found.values[:, None] ** 2 * 1.959964 * 0.25 * np.linspace(-1, 1, 4001)
    gain, phase = found.gain_band(), found.phase_band()
    assert not gain.linear_law.any() and not phase.linear_law.any()
    np.testing.assert_allclose(gain.low, np.abs(ends).min(axis=1), rtol=1e-3)
    np.testing.assert_allclose(gain.high, np.abs(ends).max(axis=1), rtol=1e-3)
    turned = np.degrees(np.angle(ends / found.values[:, None]))
    np.testing.assert_allclose(phase.low - found.phase_deg, turned.min(axis=1), rtol=1e-3)
    np.testing.assert_allclose(phase.high - found.phase_deg, turned.max(axis=1), rtol=1e-3)


def test_nonlinearity_of_a_static_gain_against_its_series():
    """1/(1 - a): the term of second order is z² s²/(1 - a)³, so that the index is sqrt(3) s/(1 - a).

    64 probes: the root of a fourth moment over a second is known to about 25 %.
    """
    for deviation in (1e-4, 1e-3, 1e-2):
        model = NarxModel.from_terms(
            {"y(k-1)": 0.8, "u(k)": 1.0}, sample_time=1.0, theta_cov=np.diag([deviation**2, 0.0])
        )
        found = propagate(model, partial(gfrf, order=1, omega=0.0))
        assert found.nonlinearity[0] == pytest.approx(math.sqrt(3) * deviation / 0.2, rel=0.5)


@pytest.mark.parametrize("name", QUANTITIES)
def test_far_outside_of_the_linear_law_a_warning_gives_the_index(name):
    with pytest.warns(UncertaintyWarning, match="nonlinearity up to"):
        found = propagate(nonlinear(0.05), QUANTITIES[name])
    assert found.status in (UncertaintyStatus.BENT, UncertaintyStatus.LOST) and not found.status.ok
    assert found.nonlinearity.max() > 0.25
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert propagate(nonlinear(1e-4), QUANTITIES[name]).nonlinearity.max() < 0.05


def test_parameters_that_lose_the_operating_point_are_said():
    """The pole is N(0.9, 0.1²): every sixth parameter is unstable."""
    model = NarxModel.from_terms({"y(k-1)": 0.9, "u(k)": 1.0}, sample_time=1.0, theta_cov=np.diag([0.01, 1e-6]))
    with pytest.warns(UncertaintyWarning, match="lost the operating point"):
        found = propagate(model, partial(gfrf, order=1, omega=[0.5, 1.0]))
    assert found.status is UncertaintyStatus.LOST
    assert found.lost == pytest.approx(0.16, abs=0.14)  # of 64: three standard deviations


def test_a_model_without_covariance_says_so():
    model = NarxModel.from_terms({"y(k-1)": 0.9, "u(k)": 1.0}, sample_time=1.0)
    found = propagate(model, partial(gfrf, order=1, omega=[0.5, 1.0]))
    assert found.status is UncertaintyStatus.CERTAIN
    np.testing.assert_array_equal(found.gain_band().high, found.gain)


# Draws


@pytest.mark.parametrize("name", QUANTITIES)
def test_many_at_once_are_those_one_by_one(name):
    model, quantity = nonlinear(0.02), QUANTITIES[name]
    response = quantity(model)
    thetas = draw_theta(model, np.random.default_rng(4), 25)
    together = evaluate(model, quantity, response, thetas)
    alone = evaluate(model, quantity, replace(response, evaluate=None), thetas)
    np.testing.assert_array_equal(together.exists, alone.exists)
    np.testing.assert_array_equal(together.stable, alone.stable)
    np.testing.assert_allclose(together.values, alone.values, rtol=1e-8, atol=1e-12)


def test_draws_without_the_operating_point_are_counted():
    """y = c + y² has an equilibrium where c < 1/4, with the pole 2y: the lower one is stable where c > -3/4.

    c is N(0.2, 0.03²): 4.8 % of 20,000 draws have none, within four standard deviations of 0.15 %.
    """
    model = NarxModel.from_terms(
        {"1": 0.2, "y(k-1)^2": 1.0, "u(k)": 1.0}, sample_time=1.0, theta_cov=np.diag([9e-4, 0.0, 1e-8])
    )
    drawn = sample(model, partial(gfrf, order=1, omega=[0.5, 1.0]), np.random.default_rng(0), 20_000)
    assert drawn.status is SampleStatus.LOST and not drawn.status.ok
    assert drawn.n_without / 20_000 == pytest.approx(stats.norm.sf(5 / 3), abs=0.006)
    assert drawn.n_other == 0 and len(drawn.draws) + drawn.n_without == 20_000


def test_draws_stay_on_the_branch_of_the_model_or_are_left_out():
    """y = c + 1.3 y - 0.3 y³, near the upper fold: the branch is there where the cubic has a positive root.

    Where it is not, another equilibrium is, far below: that is not the model's operating point.
    """
    model = NarxModel.from_terms(
        {"1": -0.1, "y(k-1)": 1.3, "y(k-1)^3": -0.3, "u(k-1)": 0.1},
        sample_time=1.0,
        theta_cov=np.diag([0.01, 0.01, 0.005, 0.01]) ** 2,
        operating=trained_on((-1, 1), (0.5, 1), output_centre=0.7),
    )
    response = gfrf(model, 1, [0.3])
    assert 0.6 < response.point.output < 0.8 and len(response.point.outputs) == 3
    thetas = draw_theta(model, np.random.default_rng(0), 400)
    found = response.evaluate(thetas)
    roots = [np.roots([c, 0.0, b - 1.0, a]) for a, b, c, _ in thetas]
    upper = np.array([r.real[np.abs(r.imag) < 1e-6].max() for r in roots])
    assert 20 < np.sum(upper < 0) < 200
    np.testing.assert_array_equal(found.exists, upper > 0)
    q = np.exp(-0.3j)
    expected = thetas[:, 3] * q / (1 - (thetas[:, 1] + 3 * thetas[:, 2] * upper**2) * q)
    np.testing.assert_allclose(found.values[found.exists, 0], expected[found.exists], rtol=1e-6)


def test_unstable_draws_are_counted():
    model = NarxModel.from_terms({"y(k-1)": 0.9, "u(k)": 1.0}, sample_time=1.0, theta_cov=np.diag([0.0025, 1e-6]))
    drawn = sample(model, partial(gfrf, order=1, omega=[0.5, 1.0]), np.random.default_rng(0), 20_000)
    assert drawn.n_other / 20_000 == pytest.approx(stats.norm.sf(2.0), abs=0.0045)
    assert drawn.n_without == 0


def test_accessors_of_draws_against_numpy():
    drawn = sample(nonlinear(), QUANTITIES["H_2"], np.random.default_rng(0), 500)
    np.testing.assert_allclose(drawn.covariance[4], np.cov(drawn.draws[:, 4].real, drawn.draws[:, 4].imag), rtol=1e-10)
    np.testing.assert_allclose(
        drawn.gain_band(0.8).low, np.quantile(np.abs(drawn.draws), 0.1, axis=0, method="weibull")
    )
    turned = np.degrees(np.angle(drawn.draws / drawn.values))
    np.testing.assert_allclose(
        drawn.phase_band(0.8).high, drawn.phase_deg + np.quantile(turned, 0.9, axis=0, method="weibull")
    )


# What is wrong is said; what is drawn has units


def test_drawings_have_units_and_say_where_the_law_fails():
    found = propagate(nonlinear(), QUANTITIES["H_1"])
    axes = found.plot()
    assert axes.get_xlabel() == "real part (m/V)" and axes.get_ylabel() == "imaginary part (m/V)"
    assert "95 % ellipses by propagation" in [text.get_text() for text in axes.get_legend().get_texts()]
    with pytest.warns(UncertaintyWarning):
        bent = propagate(nonlinear(0.05), QUANTITIES["H_1"])
    assert any("linear law fails" in text.get_text() for text in bent.plot().get_legend().get_texts())
    diagonal = partial(gfrf, order=2, omega=np.c_[OMEGA, OMEGA], operating_input=0.7)
    drawn = sample(nonlinear(), diagonal, np.random.default_rng(0), 50)
    drawn.plot()


def test_departure_of_covariances() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    reference = (turn @ np.diag([4.0, 0.01]) @ turn.T)[None]
    # 20 % less along the short axis is what counts, however short it is.
    other = (turn @ np.diag([4.2, 0.008]) @ turn.T)[None]
    assert departure(reference, other) == pytest.approx(0.2)
    np.testing.assert_allclose(np.linalg.eigvalsh(whitened(reference, other)), [[0.8, 1.05]])
    flat = (turn @ np.diag([4.0, 0.0]) @ turn.T)[None]
    assert departure(flat, 1.1 * flat) == pytest.approx(0.1)


def drawn(model: NarxModel, scale: float, seed: int) -> Spread:
    """Draws of a response that is linear in its parameters, from a covariance that is off by a factor."""
    omega = 2 * np.pi * np.linspace(0.02, 0.4, 10)
    found = spread_of("case", model, partial(gfrf, order=1, omega=omega), np.random.default_rng(seed))
    draws = found.sampled.values + scale * (found.sampled.draws - found.sampled.values)
    return replace(found, sampled=replace(found.sampled, draws=draws))


def test_a_covariance_that_is_off_is_seen() -> None:
    # b1 z^-1 + b2 z^-2 is linear in its parameters: the law is exact, and the band holds with a probability of 99 %.
    theta_cov = np.array([[1e-4, 5e-5], [5e-5, 4e-4]])
    model = replace(NarxModel.from_terms({"u(k-1)": 1.0, "u(k-2)": 0.5}, sample_time=1.0), theta_cov=theta_cov)
    right = drawn(model, 1.0, 0)
    assert right.strict.all() and right.largest < right.allowed
    assert right.held == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 20_000))
    # A variance 6 % too large is 6 % over sqrt(2/20000), 6 of its standard errors; the band is 3.6 of them wide.
    wrong = drawn(model, np.sqrt(1.06), 0)
    assert wrong.largest > wrong.allowed > 3
    assert wrong.ratio == pytest.approx(1.06, abs=0.05)
