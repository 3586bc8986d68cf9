"""Describing functions of limits and codes against python-control and quadrature."""

from itertools import pairwise

import control
import numpy as np
import pytest
from scipy.integrate import quad

from deatwin.control.checking.cycles import quantiser, saturation


def test_a_saturation_against_python_control():
    amplitude = np.geomspace(0.1, 50.0, 60)
    expected = control.describing_function(control.saturation_nonlinearity(1.3), amplitude)
    np.testing.assert_allclose(saturation(1.3, amplitude), expected, atol=1e-12)


@pytest.mark.parametrize("amplitude", [0.3, 0.4, 1.0, 5.2])
def test_a_quantiser_against_quadrature(amplitude):
    # The first harmonic over a quarter of the period; its jumps lie where the sine passes (k + 1/2) steps.
    jumps = [edge for edge in 0.7 * (np.arange(8) + 0.5) if edge < amplitude]
    ends = [0.0, *np.arcsin(np.array(jumps) / amplitude), np.pi / 2]
    parts = [
        quad(lambda t: 0.7 * np.round(amplitude * np.sin(t) / 0.7) * np.sin(t), low, high)[0]
        for low, high in pairwise(ends)
    ]
    assert quantiser(0.7, np.array(amplitude)) == pytest.approx(4 / (np.pi * amplitude) * sum(parts), abs=1e-7)
