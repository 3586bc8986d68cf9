"""PI and PID laws from their gains."""

import numpy as np
import pytest

from deatwin.control.controllers.law import Law
from deatwin.control.design.pid import PidGains
from deatwin.control.errors import ControlError

H = 0.02
PID = PidGains(proportional=0.5, integral=2.0, derivative=0.05, filter_time=0.03)


def test_a_pid_has_the_transfer_function_of_backward_differences():
    z = np.exp(1j * np.linspace(0.01, 3.0, 50))
    difference = 1.0 - 1.0 / z
    derivative = 0.05 * difference / (0.03 * difference + H)
    expected = 0.5 + 2.0 * H / difference + derivative
    law = PID.law(H)
    for (top, bottom), value in ((law.feedback, expected), (law.prefilter, expected - derivative)):
        found = np.polyval(top[::-1], 1 / z) / np.polyval(bottom[::-1], 1 / z)
        np.testing.assert_allclose(found, value, rtol=1e-10)


def test_held_at_a_limit_the_integral_follows():
    # A - L C has the eigenvalues of what is left: 1 - K_i h/K_p and the derivative's filter.
    law, windup = PID.law(H), PID.windup(H)
    held = np.linalg.eigvals(law.a - np.outer(windup, law.c))
    np.testing.assert_allclose(np.sort(held), [0.6, 1.0 - 0.08], rtol=1e-12)


@pytest.mark.parametrize(
    "gains",
    [
        PidGains(proportional=0.0, integral=2.0),
        PidGains(proportional=0.5, integral=2.0),
        PidGains(proportional=-3e4, integral=-1e5),
        PID,
    ],
)
def test_the_gains_come_back_from_the_law_whatever_it_is_scaled_by(gains):
    for factor in (1.0, -4.0):
        found = PidGains.of_law(gains.law(H).scaled(factor), H)
        assert found is not None and found.name == gains.name
        np.testing.assert_allclose(
            [found.proportional, found.integral, found.derivative],
            factor * np.array([gains.proportional, gains.integral, gains.derivative]),
            rtol=1e-9,
        )
        assert found.filter_time == pytest.approx(gains.filter_time)


def test_a_law_of_another_form_has_no_gains():
    leaky = Law.of_error([[0.9]], [0.1], [1.0], 0.5)
    assert PidGains.of_law(leaky, H) is None
    coupled = Law(a=np.array([[1.0, 0.2], [0.0, 0.5]]), b=PID.law(H).b, c=PID.law(H).c, d=PID.law(H).d)
    assert PidGains.of_law(coupled, H) is None


@pytest.mark.parametrize("sample_time", [0.0, -H, np.nan, "0.02"])
@pytest.mark.parametrize("method", [PID.law, PID.windup])
def test_a_sampling_time_that_is_not_positive_is_refused(method, sample_time):
    with pytest.raises(ControlError, match="sample_time"):
        method(sample_time)
