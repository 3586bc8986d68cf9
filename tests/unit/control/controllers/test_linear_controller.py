"""Linear laws: hand calculation, transfer functions, anti-windup."""

from dataclasses import replace

import control
import numpy as np
import pytest

from deatwin.control import ControlError, Law

H = 0.02


def test_a_sample_of_a_pi_by_hand(made):
    # K_p = 0.5, K_i h = 0.04; e = 0.1: v = 2 + 0.3 + 0.54 * 0.1; the integral becomes 0.3 + 0.04 * 0.1.
    command, state = made.pi.command(1.2, 1.1, np.array([0.3]))
    assert float(command) == pytest.approx(2.354, rel=1e-14)
    assert state == pytest.approx([0.304], rel=1e-14)


def test_a_sample_at_a_limit_by_hand(made):
    # e = 6: v = 2 + 0.3 + 3.24 = 5.54, applied 4; the integral becomes 0.3 + 0.24 - 0.08 * 1.54.
    command, state = made.pi.command(7.0, 1.0, np.array([0.3]))
    assert float(command) == 4.0
    assert state == pytest.approx([0.4168], rel=1e-14)


def test_polynomials_equal_those_of_python_control(made):
    law = made.general.law
    both = control.ss2tf(law.to_control(H))
    for found, column, sign in ((law.prefilter, 0, 1.0), (law.feedback, 1, -1.0)):
        top, bottom = np.asarray(both.num[0][column]), np.asarray(both.den[0][column])
        np.testing.assert_allclose(found[1], bottom, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found[0], sign * top, rtol=1e-9, atol=1e-9 * np.abs(top).max())


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_polynomials_keep_their_digits_in_every_unit(unit):
    # a lag: C (z - p)^-1 b = c b z^-1 / (1 - p z^-1)
    law = Law(a=[[0.9]], b=[[0.0, -0.3 * unit]], c=[2.0], d=[0.0, 0.0])
    top, bottom = law.feedback
    np.testing.assert_allclose(top, [0.0, 0.6 * unit], rtol=1e-12)
    np.testing.assert_allclose(bottom, [1.0, -0.9], rtol=1e-15)


def test_a_law_without_states_is_a_gain():
    law = Law(a=np.zeros((0, 0)), b=np.zeros((0, 2)), c=np.zeros(0), d=np.array([3.0, -2.0]))
    assert [p.tolist() for p in law.feedback] == [[2.0], [1.0]]
    assert [p.tolist() for p in law.prefilter] == [[3.0], [1.0]]
    assert law.poles.size == 0


@pytest.mark.parametrize("kind", ["pi", "scheduled"])
def test_an_anti_windup_gain_is_finite(made, kind):
    controller = getattr(made, kind)
    with pytest.raises(ControlError, match="windup must be finite"):
        replace(controller, windup=np.full(controller.windup.shape, np.nan))
