"""Bandwidth of closed loops against a closed form."""

import numpy as np
import pytest

from deatwin.control.stability.margins import bandwidth_Hz


def test_the_bandwidth_of_an_integrating_loop_is_its_crossover():
    # L = w_c/s closes to 1/(1 + s/w_c), which has lost 3 dB at w_c.
    omega = np.geomspace(0.1, 1000.0, 400)
    crossovers = np.array([2.0, 30.0])
    found = bandwidth_Hz(omega, crossovers[:, None] / (1j * omega))
    assert found == pytest.approx(crossovers / (2 * np.pi), rel=1e-3)
    assert bandwidth_Hz(omega, 1e6 / (1j * omega[None]))[0] == pytest.approx(omega[-1] / (2 * np.pi))
