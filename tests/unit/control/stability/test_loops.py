"""Margins from matrices: the same as from polynomials where those hold, and right where those hold nothing."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import linear_model
from scipy.linalg import expm

from deatwin.control import Law, LinearModel
from deatwin.control.linear.realisation import Realisation
from deatwin.control.stability.loops import loop_margins

H = 0.02
NAMES = ("gain", "phase_deg", "delay", "crossover", "disk", "modulus")


def model(realisation: Realisation) -> LinearModel:
    numerator, denominator = realisation.coefficients()
    return linear_model(numerator, denominator, realisation=realisation)


def pi(proportional: float, integral: float) -> Law:
    return Law.of_error(np.eye(1), [H * integral], [1.0], proportional)


def proportional(gain: float) -> Law:
    return Law.of_error(np.zeros((0, 0)), np.zeros(0), np.zeros(0), gain)


def random_plant(rng: np.random.Generator) -> Realisation:
    """Lags and a resonance, with two samples of delay."""
    poles = -rng.uniform(0.3, 20.0, size=2)
    turn, decay = rng.uniform(5.0, 60.0), rng.uniform(0.3, 3.0)
    continuous = np.zeros((4, 4))
    continuous[:2, :2] = np.diag(poles)
    continuous[2:, 2:] = [[-decay, turn], [-turn, -decay]]
    a = expm(H * continuous)
    b = np.zeros((4, 2))
    b[:, 1] = (np.eye(4) - a) @ rng.uniform(0.2, 1.0, size=4)
    return Realisation(a=a, b=b, c=np.array([1.0, 0.5, 0.2, 0.1]), d=np.zeros(2))


def test_they_are_those_of_the_polynomials():
    rng = np.random.default_rng(4)
    stable = 0
    for _ in range(40):
        linear = model(random_plant(rng))
        law = pi(rng.uniform(0.0, 1.5), rng.uniform(0.1, 3.0) / linear.static_gain)
        found, expected = loop_margins(linear, law), loop_margins(replace(linear, realisation=None), law)
        assert found.stable[0] == expected.stable[0]
        stable += int(found.stable[0])
        for name in NAMES:
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6, err_msg=name)
    assert 10 < stable < 40


def test_slow_modes_beside_a_lag_leave_the_margins_of_the_lag():
    """Seven modes of 2000 to 20000 s have a thousandth of the gain each: margins change by some thousandths."""
    times = np.array([0.2, *np.geomspace(2e3, 2e4, 7)])
    shares = np.array([1.0, *np.full(7, 1e-3)])
    a = np.diag(np.exp(-H / times))
    b = np.pad(-np.expm1(-H / times)[:, None], ((0, 0), (1, 0)))
    linear = model(Realisation(a=a, b=b, c=shares, d=np.zeros(2)))
    assert linear.static_gain == pytest.approx(1.007, rel=1e-9)
    alone = model(Realisation(a=a[:1, :1], b=linear.realisation.b[:1], c=shares[:1], d=np.zeros(2)))
    law = pi(0.5, 5.0)
    found, expected = loop_margins(linear, law), loop_margins(alone, law)
    assert found.stable[0]
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0.02, err_msg=name)
    # By their coefficients nothing of it is left.
    assert replace(linear, realisation=None).static_gain != pytest.approx(1.007, rel=0.1)


def test_a_loop_without_a_crossing_has_infinite_margins_and_an_unstable_one_none():
    still = model(Realisation(a=np.array([[0.5]]), b=np.array([[0.5]]), c=np.ones(1), d=np.zeros(1)))
    found = loop_margins(still, proportional(0.1))
    assert found.phase_deg[0] == found.delay[0] == np.inf
    assert found.crossover[0] == 0.0
    assert found.modulus[0] == pytest.approx(1.0 - 0.1 / 3.0, rel=1e-12)  # at half the sampling rate, L = -0.1/3
    assert found.gain[0] == pytest.approx(30.0, rel=1e-12)
    grown = loop_margins(still, proportional(4.0))
    assert not grown.stable[0]
    assert grown.gain[0] == grown.disk[0] == 0.0
