"""The linearised model against small signals, differences and the frequency response."""

import control
import numpy as np
import pytest

from deatwin.control import LinearStatus, linearise, linearise_many
from deatwin.ident.frequency import equilibrium, gfrf
from deatwin.ident.frequency.uncertainty.regions import draw_theta
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError, ReadingTime, Recording

H = 0.02
STATIC = {"y(k-1)": 0.5, "u(k-1)": 1.0}


def small_signal(model: NarxModel, point: float, size: float, deviations: np.ndarray) -> np.ndarray:
    """Free run about an equilibrium."""
    rest = equilibrium(model, point).output
    command = point + size * np.concatenate([np.zeros(model.table.max_lag), deviations])
    start = Recording.from_arrays(command, np.full(command.size, rest), model.sample_time)
    return model.simulate(start).outputs[0, model.table.max_lag :] - rest


def test_it_answers_as_the_model_does_to_small_signals(model):
    linear = linearise(model)
    deviations = np.random.default_rng(1).normal(size=100)
    size = 1e-4
    # Differences of both signs leave the odd part: the error is of the third order.
    simulated = (
        small_signal(model, linear.operating_input, size, deviations)
        - small_signal(model, linear.operating_input, -size, deviations)
    ) / (2 * size)
    response = control.forced_response(linear.system(), inputs=deviations).outputs
    assert np.abs(response - simulated).max() < 1e-4 * np.abs(simulated).max()


def test_it_has_the_frequency_response_and_the_band_of_the_gain(model):
    linear, omega = linearise(model, 2.0), np.array([0.0, 1.0, 5.0, 60.0])
    expected = gfrf(model, 1, omega, operating_input=2.0)
    np.testing.assert_allclose(linear.response(omega), expected.values, rtol=1e-10)
    np.testing.assert_allclose(linear.static_gain_deviation, expected.gain_deviation[0], rtol=1e-8)
    np.testing.assert_allclose(linear.system()(np.exp(1j * omega[1:] * H)), expected.values[1:], rtol=1e-8)
    np.testing.assert_allclose(linear.state_space()(np.exp(1j * omega[1:] * H)), expected.values[1:], rtol=1e-6)
    assert linear.system().dt == H
    assert linear.system().input_labels == ["command"]
    assert linear.status is LinearStatus.OK


def test_samples_of_the_posterior_have_its_covariance(model):
    linear = linearise(model)
    family = linearise_many(model, [linear.operating_input], draw_theta(model, np.random.default_rng(2), 2000))
    drawn = np.concatenate([family.numerators[0], family.denominators[0, :, 1:]], axis=1)
    scale = np.sqrt(np.diag(linear.covariance))
    np.testing.assert_allclose(drawn.std(axis=0), scale, rtol=0.1)
    gains = family.static_gains[0]
    assert gains.std() == pytest.approx(linear.static_gain_deviation, rel=0.1)
    assert gains.mean() == pytest.approx(linear.static_gain, abs=0.1 * linear.static_gain_deviation)


def test_the_controller_sees_one_sample_more_where_readings_end_their_rows():
    direct = NarxModel.from_terms({"u(k)": 2.0, "y(k-1)": 0.5}, sample_time=H)
    seen = linearise(direct).in_loop(ReadingTime.END_OF_HOLD)
    np.testing.assert_array_equal(seen.step_response(3), [0.0, 2.0, 3.0])
    assert seen.covariance.shape == (3, 3)
    with pytest.raises(ModelError, match="input lag 0"):
        linearise(direct).in_loop(ReadingTime.START_OF_HOLD)
    lagged = linearise(NarxModel.from_terms(STATIC, sample_time=H))
    assert lagged.in_loop(ReadingTime.START_OF_HOLD) is lagged


@pytest.mark.parametrize(
    ("terms", "cov", "status"),
    [
        ({"y(k-1)": 1.2, "u(k-1)": 1.0}, 0.0, LinearStatus.UNSTABLE),
        ({"y(k-1)": 1.0, "y(k-1)^2": 1.0, "1": 1.0, "u(k-1)": 0.0}, 0.0, LinearStatus.NO_EQUILIBRIUM),
        ({"y(k-1)": 1.0}, 0.0, LinearStatus.NO_EQUILIBRIUM),
        ({"y(k-1)": 0.5, "u(k-1)": 1.0, "u(k-2)": -1.0}, 0.0, LinearStatus.NO_GAIN),
        ({"y(k-1)": 0.5}, 0.0, LinearStatus.NO_GAIN),
        (STATIC, 1.0, LinearStatus.NO_GAIN),
        (STATIC, 0.01, LinearStatus.OK),
    ],
)
def test_status(terms, cov, status):
    linear = linearise(NarxModel.from_terms(terms, sample_time=H, theta_cov=cov * np.eye(len(terms))))
    assert linear.status is status
    assert np.isfinite(linear.numerator).all() and np.isfinite(linear.denominator).all()
    if not status.ok:
        with pytest.raises(ModelError, match=status.value[:20]):
            linear.require()
