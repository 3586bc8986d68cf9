"""LQG: poles, times, Kalman gains and limits."""

import control
import numpy as np
import pytest
from made_models import linear_model

from deatwin.control import ControlError
from deatwin.control.design.lqg import lqg, lqg_gains
from deatwin.control.design.states import States

H = 0.02
LIMITS = (1.0, 4.0)


@pytest.fixture(params=["fast", "lag", "second", "creeping"])
def linear(request, sampled):
    return {
        "fast": sampled(-2.0, [0.004], delay=1),
        "lag": sampled(3.0, [0.5], delay=2),
        "second": sampled(2.0e-4, [0.6, 0.2]),
        "creeping": sampled(-1.0, [10.0, 0.1], [8.5]),
    }[request.param]


def steps(closed, samples):
    return np.asarray(control.forced_response(closed, H * np.arange(samples), np.ones(samples)).outputs)


def test_the_states_have_the_models_response(linear):
    states, z = States.of(linear), np.exp(1j * np.geomspace(1e-3, np.pi, 50))
    for form, tolerance in ((states, 1e-11), (states.balanced(), 1e-7)):  # what balancing may leave out
        found = [form.gain * form.c @ np.linalg.solve(v * np.eye(form.b.size) - form.a, form.b) for v in z]
        expected = linear.response(np.angle(z) / H)
        np.testing.assert_allclose(found, expected, atol=tolerance * np.abs(linear.static_gain))


def test_balanced_states_leave_out_what_cancels(sampled):
    assert States.of(sampled(1.0, [0.5, 0.3], [0.3])).balanced().b.size == 1


def test_closed_loop_poles_are_those_of_regulator_and_observer(linear, around):
    found = lqg(linear, command_limits=LIMITS, closed_loop_time=0.5, noise=2.0, drift=5.0)
    gains = lqg_gains(linear, 0.5, 5.0 * np.sqrt(H) / 2.0)
    states, one = gains.states, np.ones((1, 1))
    rest = np.zeros((1, states.b.size))
    summed, drifting = (
        np.block([[states.a, states.b[:, None]], [rest, one]]),
        np.block([[states.a, rest.T], [rest, one]]),
    )
    regulated = summed - np.outer(np.append(states.b, 1.0), gains.regulator)
    observed = drifting - np.outer(drifting @ gains.observer, np.append(states.c, 1.0))
    both = np.concatenate([np.linalg.eigvals(regulated), np.linalg.eigvals(observed)])
    # As polynomials: poles of the delay lie many at zero, where a pole moves by the root of rounding.
    closed = np.poly(np.linalg.eigvals(around(linear, found).A)).real
    np.testing.assert_allclose(closed, np.poly(both).real, atol=1e-8)
    assert np.all(np.abs(both) < 1.0)


def test_the_regulator_is_that_of_python_control(linear):
    gains = lqg_gains(linear, 0.5, 0.3)
    states = gains.states
    a = np.block([[states.a, states.b[:, None]], [np.zeros((1, states.b.size)), np.ones((1, 1))]])
    b, seen = np.append(states.b, 1.0), np.append(states.c, 0.0)
    # The weight that belongs to the gain K: P = A'P(A - bK) + cc' is linear in P, and rho K = b'P(A - bK).
    closed = a - np.outer(b, gains.regulator)
    n = b.size
    p = np.linalg.solve(np.eye(n * n) - np.kron(a.T, closed.T), np.outer(seen, seen).ravel()).reshape(n, n)
    weight = (b @ p @ closed) @ gains.regulator / (gains.regulator @ gains.regulator)
    expected, _, _ = control.dlqr(a, b[:, None], np.outer(seen, seen), np.array([[weight]]))
    np.testing.assert_allclose(gains.regulator, np.ravel(expected), rtol=1e-5, atol=1e-7 * np.abs(expected).max())


def test_the_observer_is_that_of_python_control(linear):
    gains = lqg_gains(linear, 0.5, 0.3)
    states, n = gains.states, gains.states.b.size
    a = np.eye(n + 1)
    a[:n, :n] = states.a
    pushes = np.zeros((n + 1, 2))
    pushes[:n, 0], pushes[n, 1] = states.b, 1.0
    seen = np.append(states.c, 1.0)[None, :]
    predictor, _, _ = control.dlqe(a, pushes, seen, 0.3**2 * np.eye(2), np.ones((1, 1)))
    np.testing.assert_allclose(a @ gains.observer, np.ravel(predictor), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("time", [0.3, 1.0])
def test_a_step_is_answered_in_the_time_that_was_asked_for(linear, around, time):
    found = lqg(linear, command_limits=LIMITS, closed_loop_time=time)
    output, command = steps(around(linear, found), 6000)
    after = np.argmax(output > 1 - np.exp(-1))
    before = output[after - 1]
    reached = after - (output[after] - 1 + np.exp(-1)) / (output[after] - before)
    delay = int(np.flatnonzero(linear.numerator)[0]) - 1
    assert (reached - delay) * H == pytest.approx(time, rel=1e-3)
    assert output[-1] == pytest.approx(1.0, abs=1e-6)
    assert command[-1] * linear.static_gain == pytest.approx(1.0, abs=1e-6)


def test_a_wandering_output_is_followed_faster_than_a_noisy_one(sampled, around):
    linear = sampled(2.0, [0.3], delay=1)
    quick, calm = (lqg(linear, command_limits=LIMITS, closed_loop_time=0.5, drift=d, noise=1.0) for d in (30.0, 0.3))
    assert abs(quick.law.d[1]) > 5.0 * abs(calm.law.d[1])  # how much of a reading is believed at once
    slowest = [np.abs(np.linalg.eigvals(around(linear, c).A)).max() for c in (quick, calm)]
    assert slowest[0] < slowest[1]


def test_what_cannot_be_reached_is_refused_with_what_can(sampled):
    linear = sampled(1.0, [2.0, 1.0], [-0.5])  # answers first to the wrong side
    with pytest.raises(ControlError, match=r"cannot be reached: the model allows") as error:
        lqg(linear, command_limits=LIMITS, closed_loop_time=0.05)
    # The zero to the right, of 0.5 s, keeps the answer below zero for a good part of that.
    assert float(str(error.value).split("allows ")[1].split(" s")[0]) > 0.2


def test_a_controller_whose_polynomials_lose_their_digits_is_refused():
    """A lag of 200 s sampled every 0.02 s: three poles within 1e-4 of each other beside 1."""
    pole = np.exp(-0.02 / 200.0)
    slow = linear_model([0.0, 1.0 - pole], [1.0, -pole])
    with pytest.raises(ControlError, match="loses its digits"):
        lqg(slow, command_limits=(-1.0, 1.0), closed_loop_time=200.0)
