"""PI and PID laws from their gains."""

import numpy as np
import pytest

from deatwin.control import ControlError
from deatwin.control.design.pid import PidGains

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


def test_the_name_says_what_is_there():
    names = [PidGains(proportional=p, integral=1.0, derivative=d, filter_time=0.1).name
             for p, d in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))]  # fmt: skip
    assert names == ["I", "PI", "PID"]


def test_held_at_a_limit_the_integral_follows():
    # A - L C has the eigenvalues of what is left: 1 - K_i h/K_p and the derivative's filter.
    law, windup = PID.law(H), PID.windup(H)
    held = np.linalg.eigvals(law.a - np.outer(windup, law.c))
    np.testing.assert_allclose(np.sort(held), [0.6, 1.0 - 0.08], rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"integral": 0.0}, "needs integral action"),
        ({"integral": np.nan}, "must be finite"),
        ({"filter_time": 0.0}, "positive filter_time"),
        ({"filter_time": -0.1}, "positive filter_time"),
    ],
)
def test_senseless_gains_are_refused(changes, message):
    values = {"proportional": 0.5, "integral": 2.0, "derivative": 0.05, "filter_time": 0.03}
    with pytest.raises(ControlError, match=message):
        PidGains(**(values | changes))
