"""The analytic band of a loop against draws of its coefficients and closed forms."""

import numpy as np
import pytest
from made_models import linear_model
from scipy.stats import norm

from deatwin.control.errors import ControlError
from deatwin.control.stability.bands import _distance, _response, band_margins, stable_probability
from deatwin.control.stability.margins import margins
from deatwin.control.stability.polynomials import in_series
from deatwin.plant.errors import ModelError

H = 0.02
PI = (np.array([2.64, -2.6]), np.array([1.0, -1.0]))


def linear(scale=1.0):
    """A double lag with a delay; the covariance has rank 4, as b_0 and b_1 are known to be zero."""
    pole = np.exp(-H / 0.3)
    numerator = 0.5 * np.array([0.0, 0.0, 0.6 * (1 - pole), 0.4 * (1 - pole)])
    denominator = np.convolve([1.0, -pole], [1.0, -0.5])
    root = np.random.default_rng(0).normal(size=(6, 6)) * np.array([0, 0, 6e-4, 6e-4, 9e-4, 9e-4])[:, None] * scale
    return linear_model(numerator, denominator, covariance=root @ root.T, operating_input=2.4, operating_output=1e-3)


def drawn(model, count, seed=1):
    mean = np.concatenate([model.numerator, model.denominator[1:]])
    draws = np.random.default_rng(seed).multivariate_normal(mean, model.covariance, count, method="svd")
    ones = np.ones((count, 1))
    numerators, denominators = draws[:, : model.numerator.size], np.hstack([ones, draws[:, model.numerator.size :]])
    return in_series(numerators, PI[0]), in_series(denominators, PI[1])


@pytest.fixture(scope="module")
def sampled():
    return margins(*drawn(linear(), 20000), H)


@pytest.mark.parametrize(("name", "of"), [("gain", np.log), ("phase_deg", None), ("delay", None), ("disk", np.log)])
def test_deviations_and_limits_agree_with_draws(name, of, sampled):
    found = getattr(band_margins(linear(), *PI), name)
    values = getattr(sampled, name) if of is None else of(getattr(sampled, name))
    # A deviation of 20 000 draws is known to 0.5 %; what is not linear adds some percent at this uncertainty.
    assert found.deviation == pytest.approx(values.std(), rel=0.05)
    centre = found.value if of is None else of(found.value)
    low = found.low if of is None else of(found.low)
    assert low == pytest.approx(np.quantile(values, 0.025), abs=0.25 * values.std())
    reach = 1.96 * found.deviation  # of the loop's size, where the margin is that of the gain
    assert centre - low == pytest.approx(np.log1p(reach) if name == "gain" else reach, rel=1e-3)


@pytest.mark.parametrize("name", ["gain", "phase_deg", "delay", "disk"])
def test_deviations_are_the_derivatives_of_the_margins(name):
    model = linear()
    found = getattr(band_margins(model, *PI), name)
    theta = np.concatenate([model.numerator, model.denominator[1:]])
    gradient = np.zeros(6)
    for k in range(2, 6):
        values = []
        for step in (-1e-6, 1e-6):
            moved = theta.copy()
            moved[k] += step
            loop = in_series(moved[:4], PI[0]), in_series(np.concatenate([[1.0], moved[4:]]), PI[1])
            value = getattr(margins(*loop, H), name)[0]
            values.append(np.log(value) if name in ("gain", "disk") else value)
        gradient[k] = (values[1] - values[0]) / 2e-6
    # Central differences of 1e-6: rounding of the margins, 1e-13, by the step leaves 1e-7.
    assert found.deviation == pytest.approx(np.sqrt(gradient @ model.covariance @ gradient), rel=1e-5)


def test_an_uncertain_gain_alone_in_closed_form():
    # L = b z^-2 / (1 - z^-1), only b uncertain: ln gain margin changes as -ln b does, the phase margin is
    # pi/2 - 3 arcsin(b/2), and the locus moves along its own rays.
    b, deviation = 0.1, 0.004
    covariance = np.zeros((3, 3))
    covariance[2, 2] = deviation**2
    model = linear_model([0.0, 0.0, b], [1.0], covariance=covariance)
    found = band_margins(model, [1.0], [1.0, -1.0])
    assert found.gain.deviation == pytest.approx(deviation / b, rel=1e-9)
    assert found.gain.low == pytest.approx(1.0 / (b + 1.959964 * deviation), rel=1e-6)  # b is normal: exactly so
    slope = 1.5 / np.sqrt(1 - b**2 / 4)
    assert found.phase_deg.deviation == pytest.approx(np.degrees(slope * deviation), rel=1e-9)
    assert found.radius == pytest.approx(1.959964, rel=1e-6)  # of one direction
    # -1 is nearest to the band where b is largest: the band of a segment is the set of loops up to that gain.
    largest = margins([0.0, 0.0, b + found.radius * deviation], [1.0, -1.0], H).modulus[0]
    assert found.modulus_low == pytest.approx(largest, rel=1e-4)  # on a grid of 2000 frequencies


def test_the_simultaneous_band_holds_whole_loci_at_its_level():
    model = linear()
    found = band_margins(model, *PI)
    tops, bottoms = drawn(model, 4000, seed=3)
    # The bound is a shadow of the ellipsoid of 95 %: the distance of a draw is less in 5 % at most, here in far less.
    below = margins(tops, bottoms, H).modulus < found.modulus_low
    assert below.mean() <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 4000)
    assert found.modulus_low < found.modulus
    # The ellipses are the shadow itself: at each frequency the draws touch their outline at the radius.
    shift = np.exp(-1j * found.response.omega[::100] * H)
    powers = shift ** np.arange(max(tops.shape[1], bottoms.shape[1]))[:, None]
    loci = (tops @ powers[: tops.shape[1]]) / (bottoms @ powers[: bottoms.shape[1]])
    away = loci - found.response.values[::100]
    parts = np.stack([away.real, away.imag], axis=-1)
    distance = np.einsum("kni,nij,knj->kn", parts, np.linalg.inv(found.response.covariance[::100]), parts)
    share = (distance.max(axis=1) <= found.radius**2).mean()
    assert share >= 0.95 - 3 * np.sqrt(0.05 * 0.95 / 4000)


def test_a_certain_model_has_the_margins_of_the_model():
    model = linear(0.0)
    found = band_margins(model, *PI)
    own = margins(in_series(model.numerator, PI[0]), in_series(model.denominator, PI[1]), H)
    assert found.gain.low == pytest.approx(own.gain[0], rel=1e-12)
    assert found.disk.low == pytest.approx(own.disk[0], rel=1e-9)
    assert found.modulus_low == pytest.approx(own.modulus[0], rel=1e-9)
    assert found.radius == 0.0


def test_a_band_that_holds_minus_one_has_no_distance_from_it():
    assert band_margins(linear(30.0), *PI).modulus_low == 0.0


@pytest.mark.parametrize(("gain", "deviation"), [(1.9, 0.5), (1.5, 0.5), (1.0, 0.2)])
def test_the_probability_of_an_uncertain_gain_in_closed_form(gain, deviation):
    # L = b z^-1 / (1 - z^-1) is stable for 0 < b < 2, and at its limit z = -1, where the band is a segment.
    covariance = np.diag([0.0, deviation**2])
    found = band_margins(linear_model([0.0, gain], [1.0], covariance=covariance), [1.0], [1.0, -1.0])
    away = (2.0 - gain) / deviation
    assert (found.modulus_low == 0.0) is (away < found.radius)
    assert stable_probability(found) == pytest.approx(norm.cdf(away) if away < found.radius else 1.0, rel=1e-9)


def test_a_resonance_between_two_points_of_the_grid_is_resolved():
    # L = k z^-1/(1 - z^-1) + a resonance of the width 1e-4 with an uncertain numerator. The grid is compared with one
    # of a hundredth of that width, on which the parabola about the nearest point of an ellipse is flat to 1e-4.
    radius, angle = 1.0 - 1e-4, 2.9
    pole = radius * np.exp(1j * angle)
    size = 0.6e-4 * np.exp(1j * (angle + 2.0))
    denominator = np.array([1.0, -2 * pole.real, radius**2])
    resonance = [0.0, 2 * size.real, -2 * (size * pole.conjugate()).real]
    numerator = in_series([0.0, 0.05], denominator) + in_series(resonance, [1.0, -1.0])
    covariance = np.diag([0.0, 1e-10, 1e-10, 1e-10, 0.0, 0.0])
    model = linear_model(numerator, denominator, covariance=covariance)
    found = band_margins(model, [1.0], [1.0, -1.0])
    dense = _response(model, (np.array([1.0]), np.array([1.0, -1.0])), angle + np.linspace(-3e-3, 3e-3, 6001))
    assert found.modulus_low == pytest.approx(_distance(dense, found.radius).min(), rel=1e-3)


def test_a_less_close_but_less_certain_approach_limits_the_disk_margin():
    # The loop is nearest to -1 at half the sampling rate, and certain there: L = -0.6. A resonance is only a little
    # farther away, and its size has a deviation of 30 %.
    pole = 0.99 * np.exp(2.0j)
    denominator, size = np.array([1.0, -2 * pole.real, 0.99**2]), 1e-3 * np.exp(1j * (1.23 + np.pi))
    resonance = in_series([0.0, 2 * size.real, -2 * (size * pole.conjugate()).real], [1.0, -1.0])
    numerator = in_series([0.0, 1.2], denominator) + resonance
    moved = 0.3 * np.append(resonance, [0.0, 0.0])
    model = linear_model(numerator, denominator, covariance=np.outer(moved, moved))
    draws = numerator + np.random.default_rng(0).standard_normal((4000, 1)) * moved[: numerator.size]
    drawn = margins(draws, in_series(denominator, [1.0, -1.0]), H)
    found = band_margins(model, [1.0], [1.0, -1.0]).disk
    assert found.value == pytest.approx(2 * 0.4 / 1.6, rel=0.01)
    # The logarithm's deviation is 0.05; what first order neglects of it is its square, 0.2 %, at two deviations 1 %.
    assert found.low == pytest.approx(np.quantile(drawn.disk, 0.025), rel=0.02)


def test_a_margin_that_nothing_bounds_is_infinite_and_not_nan():
    model = linear_model([0.0, 0.1], [1.0, -0.5], covariance=1e-6 * np.eye(3))
    found = band_margins(model, [1.0], [1.0])
    assert found.phase_deg.value == found.phase_deg.low == found.delay.low == np.inf
    assert found.phase_deg.deviation == 0.0
    assert np.isfinite([found.gain.value, found.gain.low, found.disk.low, found.modulus_low]).all()


def test_an_unstable_loop_and_a_wrong_level_are_refused():
    with pytest.raises(ControlError, match="unstable"):
        band_margins(linear(), 50 * PI[0], PI[1])
    with pytest.raises(ControlError, match="level"):
        band_margins(linear(), *PI, level=1.0)
    with pytest.raises(ModelError):
        band_margins(
            linear_model([0.0], [1.0], covariance=[[0.0]], operating_output=None, status=_no_equilibrium()), *PI
        )


def _no_equilibrium():
    from deatwin.control.linear.model import LinearStatus

    return LinearStatus.NO_EQUILIBRIUM


def test_the_picture_shows_locus_ellipses_and_minus_one():
    axes = band_margins(linear(), *PI).plot()
    labels = axes.get_legend_handles_labels()[1]
    assert set(labels) == {
        "loop of the model",
        "nearest the band comes to -1",
        "-1",
        "95 % band, all frequencies at once",
    }
    assert axes.get_xlabel() == "real part of L"


def test_a_crossing_where_nearly_nothing_is_left_of_the_loop_does_not_spoil_the_limit():
    # L = (g + b z^-1) / (1 - p z^-1): at half the sampling rate (g - b)/(1 + p) is 1e-3, its deviation ten times that,
    # whose logarithm knows no bound; the loop itself stays within 0.03 there.
    covariance = np.zeros((3, 3))
    covariance[1, 1] = 0.02**2
    model = linear_model([0.4, 0.402], [1.0, -0.5], covariance=covariance)
    found = band_margins(model, [1.0], [1.0])
    assert found.gain.value == pytest.approx(750.0, rel=1e-6)
    assert found.gain.low == pytest.approx(1.0 / ((0.002 + 1.959964 * 0.02) / 1.5), rel=1e-6)
