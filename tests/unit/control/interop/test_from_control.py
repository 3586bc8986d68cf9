"""Linear systems of python-control as linear models."""

import control
import numpy as np
import pytest

from deatwin.control.errors import ControlError
from deatwin.control.interop.from_control import from_control
from deatwin.control.linear.model import LinearStatus
from deatwin.control.linear.narx import linearise
from deatwin.control.stability.bands import band_margins
from deatwin.plant.rigs.base import ReadingTime

H = 0.02
OMEGA = np.array([0.0, 0.5, 5.0, 50.0, 150.0])


@pytest.mark.parametrize("way", ["system", "state_space"])
def test_there_and_back_is_the_same_model(model, way):
    linear = linearise(model, 2.4)
    there = getattr(linear, way)()
    back = from_control(
        there, operating_input=2.4, operating_output=linear.rest_output, input_unit="V", output_unit="m"
    )
    scale = np.abs(linear.numerator).max()
    # A state space holds its coefficients to rounding.
    np.testing.assert_allclose(back.numerator, linear.numerator, atol=1e-12 * scale)
    np.testing.assert_allclose(back.denominator, linear.denominator, atol=1e-12)
    assert (back.operating_input, back.operating_output) == (2.4, linear.rest_output)
    assert (back.input_name, back.output_name, back.sample_time) == ("command", "displacement", H)
    assert (back.input_unit, back.output_unit) == ("V", "m")
    assert back.status is LinearStatus.OK
    assert not back.covariance.any()


@pytest.mark.parametrize(
    "system",
    [
        control.tf([2.0], [4.0, -2.0], H),
        control.tf([0.0, 0.0, 1.0, 0.3], [1.0, -1.2, 0.5], H),
        control.tf([1.0, 0.3, 0.0], [1.0, -1.2, 0.5], H),
        control.zpk([0.3, -0.2], [0.5, 0.9, 0.1], 2.0, dt=H),
        control.ss([[0.5, 0.2], [-0.1, 0.8]], [[1.0], [0.5]], [[1.0, -2.0]], [[0.7]], H),
        control.tf([3.0], [1.0], H),
        control.ss([], [], [], [[2.0]], H),
    ],
)
def test_it_has_the_system_s_frequency_response(system):
    linear = from_control(system)
    np.testing.assert_allclose(linear.response(OMEGA), system(np.exp(1j * OMEGA * H)), rtol=1e-12)
    assert linear.denominator[0] == 1.0
    np.testing.assert_allclose(linear.static_gain, system.dcgain(), rtol=1e-12)


def test_a_state_space_with_many_slow_modes_keeps_its_digits():
    lags = np.array([2000.0, 2100.0, 2200.0, 2300.0, 2400.0])
    poles = np.exp(-H / lags)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((5, 5)))[0]
    a, b, c = turn @ np.diag(poles) @ turn.T, turn @ (1.0 - poles)[:, None], 0.2 * np.ones((1, 5)) @ turn.T
    linear = from_control(control.ss(a, b, c, 0.0, H))
    # The matrices hold 1 - p, of 1e-5, to 1e-11.
    assert linear.static_gain == pytest.approx(1.0, rel=1e-9)
    omega = 2 * np.pi * np.array([1e-4, 1e-3, 1e-1])
    lagging = np.mean((1.0 - poles) / (np.exp(1j * omega * H)[:, None] - poles), axis=1)
    np.testing.assert_allclose(linear.response(omega), lagging, rtol=1e-8)
    assert linear.status is LinearStatus.OK
    assert linear.detail.startswith("the system has many slow modes")
    with pytest.raises(ControlError, match="no band of the loop: the system has many slow modes"):
        band_margins(linear.in_loop(ReadingTime.END_OF_HOLD), [1.0], [1.0])


@pytest.mark.parametrize(
    ("system", "status"),
    [
        (control.tf([1.0], [1.0, -1.0], H), LinearStatus.UNSTABLE),
        (control.tf([1.0], [1.0, -1.5], H), LinearStatus.UNSTABLE),
        (control.tf([1.0, -1.0], [1.0, -0.5], H), LinearStatus.NO_GAIN),
        (control.ss([[0.5, 0.0], [0.0, 2.0]], [[1.0], [0.0]], [[1.0, 1.0]], [[0.0]], H), LinearStatus.UNSTABLE),
    ],
)
def test_its_status_says_what_a_controller_could_not_be_designed_on(system, status):
    assert from_control(system).status is status


@pytest.mark.parametrize(
    ("system", "said"),
    [
        (control.tf([1.0], [1.0, 1.0]), "continuous"),
        (control.ss(-1.0, 1.0, 1.0, 0.0), "continuous"),
        (control.tf([1.0], [1.0, 0.5], True), "dt = True"),
        (control.tf([1.0], [1.0], None), "continuous"),
        (control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), H), "2 inputs and 2 outputs"),
        (control.tf([1.0, 0.0, 0.0], [1.0, 0.5], H), "improper"),
        (control.frd([1.0], [1.0], H), "not a transfer function or state space"),
        (control.nlsys(lambda t, x, u, p: x, inputs=1, outputs=1, states=1, dt=H), "linearize"),
        (control.tf([np.nan], [1.0, 0.5], H), "finite"),
        (np.ones(3), "not a transfer function"),
    ],
)
def test_another_system_is_one_clear_error(system, said):
    with pytest.raises(ControlError, match=said):
        from_control(system)
