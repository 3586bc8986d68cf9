"""Margins and limit cycles of textbook loops.

The loops are continuous; Tustin's rule z = (1 + sh/2)/(1 - sh/2) carries the imaginary axis to the unit circle, so that
the sampled loop has exactly the gain, phase and disk margins of the continuous one, and a crossing at w lies at
(2/h) arctan(wh/2). The numbers are derived beside each test; the loops are those of

- Khalil, Nonlinear Systems (3rd ed., 2002), section 7.2: 1/(s(s + 1)(s + 2)) with a relay;
- Seiler, Packard, Gahinet, An introduction to disk margins, IEEE Control Systems Magazine 40 (2020): 25/(s³ + 10s² +
  10s + 10);
- Åström, Murray, Feedback Systems (2008), section 9.3: gain, phase and stability (modulus) margin, on 3/(s + 1)³.
"""

import control
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from deatwin.control.stability.limit_cycles import limit_cycles
from deatwin.control.stability.margins import margins

H = 0.05


def tustin(numerator, denominator):
    """Coefficients of z^0, z^-1, ... of a continuous loop, highest powers of s first."""
    order = len(denominator) - 1

    def carried(coefficients):
        total = np.zeros(order + 1)
        for power, value in enumerate(reversed(coefficients)):
            one = np.array([1.0])
            for _ in range(power):
                one = np.convolve(one, [2 / H, -2 / H])
            for _ in range(order - power):
                one = np.convolve(one, [1.0, 1.0])
            total += value * one
        return total

    return carried(numerator), carried(denominator)


def sampled(omega):
    return 2 / H * np.arctan(omega * H / 2)


def least(function, low, high):
    """The least value of a function with one minimum between two frequencies."""
    return minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-9}).fun


def test_three_equal_lags():
    # 3/(s + 1)³ turns by 180° at sqrt(3), where it is 3/8; its gain is one where 1 + w² = 3^(2/3).
    found = margins(*tustin([3.0], np.poly([-1.0, -1.0, -1.0])), H)
    omega = np.sqrt(3 ** (2 / 3) - 1)
    assert found.gain[0] == pytest.approx(8 / 3, rel=1e-9)
    assert found.phase_deg[0] == pytest.approx(180 - 3 * np.degrees(np.arctan(omega)), rel=1e-9)
    assert found.crossover[0] == pytest.approx(sampled(omega), rel=1e-9)
    assert found.modulus[0] == pytest.approx(least(lambda w: abs(1 + 3 / (1 + 1j * w) ** 3), 0.0, 3.0), rel=1e-9)


@pytest.mark.parametrize("gain", [1.0, 3.0, 5.9])
def test_an_integrator_and_two_lags(gain):
    # K/(s(s + 1)(s + 2)) is -K/6 at sqrt(2), by Routh stable up to K = 6.
    found = margins(*tustin([gain], np.poly([0.0, -1.0, -2.0])), H)
    assert found.gain[0] == pytest.approx(6 / gain, rel=1e-9)
    assert not margins(*tustin([6.001], np.poly([0.0, -1.0, -2.0])), H).stable[0]


def test_the_example_of_the_introduction_to_disk_margins():
    bottom = [1.0, 10.0, 10.0, 10.0]
    found = margins(*tustin([25.0], bottom), H)
    # s³ + 10s² + 10s + 10 + 25g has roots on the axis where 10 * 10 = 10 + 25g: g = 3.6, at sqrt(10).
    assert found.gain[0] == pytest.approx(3.6, rel=1e-9)
    # |L| = 1: (10 - 10x)² + x(10 - x)² = 625 with x = w².
    roots = np.roots([1.0, 80.0, -100.0, 100.0 - 625.0])
    x = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0)].real.item()
    s = 1j * np.sqrt(x)
    assert found.phase_deg[0] == pytest.approx(np.degrees(np.angle(-25 / np.polyval(bottom, s))), rel=1e-9)

    def disk(omega):  # of S - T = (1 - L)/(1 + L)
        loop = 25 / np.polyval(bottom, 1j * omega)
        return 2 * abs((1 + loop) / (1 - loop))

    assert found.disk[0] == pytest.approx(least(disk, 1.0, 4.0), rel=1e-9)
    # Its disk in terms of gain and phase: the real factor and the turn (1 + jt)/(1 - jt) at its rim.
    assert found.disk_gain[0] == pytest.approx((2 + found.disk[0]) / (2 - found.disk[0]), rel=1e-12)
    assert found.disk_phase_deg[0] == pytest.approx(2 * np.degrees(np.arctan(found.disk[0] / 2)), rel=1e-12)
    assert found.disk_gain[0] < found.gain[0]
    assert found.disk_phase_deg[0] < found.phase_deg[0]


def test_the_disk_margin_of_a_first_order_loop():
    # k/s: |s + k|/|s - k| = 1 on the whole axis, so that alpha is 2: any gain, and a quarter turn of phase.
    found = margins(*tustin([0.7], [1.0, 0.0]), H)
    assert found.disk[0] == pytest.approx(2.0, rel=1e-9)
    assert found.disk_phase_deg[0] == pytest.approx(90.0, rel=1e-9)
    assert found.phase_deg[0] == pytest.approx(90.0, rel=1e-9)
    assert found.gain[0] == np.inf


def relay(level, band=0.0):
    """N of a relay with hysteresis, by python-control."""
    known = control.relay_hysteresis_nonlinearity(level, band)
    return lambda amplitude, omega: control.describing_function(known, np.ravel(amplitude)).reshape(amplitude.shape)


@pytest.mark.parametrize("level", [1.0, 2.5])
def test_a_relay_with_an_integrator_and_two_lags(level):
    # 4 level/(pi A) * 1/6 = 1 at sqrt(2): A = 2 level/(3 pi).
    top, bottom = tustin([1.0], np.poly([0.0, -1.0, -2.0]))
    found = limit_cycles(top, bottom, H, relay(level), np.geomspace(0.01, 10, 100), np.geomspace(0.1, 20, 100))
    assert len(found) == 1
    assert found[0].amplitude == pytest.approx(2 * level / (3 * np.pi), rel=1e-9)
    assert 2 * np.pi * found[0].frequency_Hz == pytest.approx(sampled(np.sqrt(2)), rel=1e-9)
    assert found[0].stable


def test_a_relay_with_hysteresis_and_an_integrator_with_a_lag():
    # 1/(s(s + 1)): -1/N = -(pi/4M)(sqrt(A² - d²) + jd), met where Im L = -1/(w(1 + w²)) = -pi d/(4M).
    level, band = 1.0, 0.3
    roots = np.roots([1.0, 0.0, 1.0, -4 * level / (np.pi * band)])
    omega = roots[abs(roots.imag) < 1e-12].real.item()
    amplitude = np.hypot(band, 4 * level / (np.pi * (1 + omega**2)))
    top, bottom = tustin([1.0], [1.0, 1.0, 0.0])
    found = limit_cycles(top, bottom, H, relay(level, band), np.geomspace(0.31, 10, 100), np.geomspace(0.1, 20, 100))
    assert len(found) == 1
    assert found[0].amplitude == pytest.approx(amplitude, rel=1e-9)
    assert 2 * np.pi * found[0].frequency_Hz == pytest.approx(sampled(omega), rel=1e-9)
    assert found[0].stable
