"""Limit cycles against closed forms, python-control and simulated loops."""

import control
import numpy as np
import pytest

from deatwin.control.checking.cycles import quantiser, saturation
from deatwin.control.stability.limit_cycles import limit_cycles

H = 0.01


def of(nonlinearity):
    """N(A, w) of a static nonlinearity of python-control."""
    return lambda amplitude, omega: control.describing_function(nonlinearity, amplitude.ravel()).reshape(
        amplitude.shape
    )


LIMITED = of(control.saturation_nonlinearity(1.0))
RELAY = of(control.relay_hysteresis_nonlinearity(1.0, 0.0))


def dead_zone(amplitude, omega):
    """N of what a saturation at 0.1 takes away."""
    return 1.0 - saturation(0.1, amplitude)


def third_order(gain):
    """gain / (s (s + 1) (s + 2)) behind a hold, sampled."""
    system = control.sample_system(control.tf([gain], [1.0, 3.0, 2.0, 0.0]), H)
    top, bottom = system.num[0][0], system.den[0][0]
    return np.pad(top, (bottom.size - top.size, 0)), bottom


def simulated(nonlinearity, top, bottom, count, start):
    """y = L(-f(y)), sample by sample; the outputs."""
    order = len(bottom) - 1
    y, u = [start] * order, [0.0] * order  # the integrator rests anywhere
    for _ in range(count):
        u.append(-float(nonlinearity(y[-1])))
        y.append(sum(top[k] * u[-k] - bottom[k] * y[-k] for k in range(1, order + 1)))
    return np.array(y)


def cycle_of(y):
    """Amplitude of the first harmonic, and frequency in Hz, over the last whole periods."""
    last = y[y.size // 2 :] - y[y.size // 2 :].mean()
    rises = np.flatnonzero((last[:-1] < 0) & (last[1:] >= 0))
    exact = rises - last[rises] / (last[rises + 1] - last[rises])
    period = (exact[-1] - exact[0]) / (rises.size - 1)
    k = np.arange(rises[0], rises[-1])
    return 2 * abs(np.mean(last[k] * np.exp(-2j * np.pi * k / period))), 1 / (period * H)


def test_a_relay_with_a_sampled_integrator_and_a_delay_in_closed_form():
    # L = k z^-2/(1 - z^-1) is -k at a third of pi; the relay's 4/(pi A) makes it -1 there.
    amplitudes, omegas = np.geomspace(0.01, 10, 50), np.geomspace(1, 314, 60)
    found = limit_cycles(
        [0, 0, 0.3], [1, -1], H, of(control.relay_hysteresis_nonlinearity(2.0, 0.0)), amplitudes, omegas
    )
    assert len(found) == 1
    assert found[0].amplitude == pytest.approx(4 * 2.0 * 0.3 / np.pi, rel=1e-9)
    assert found[0].frequency_Hz == pytest.approx(1 / (6 * H), rel=1e-9)
    assert found[0].stable


def test_saturation_and_dead_zone_share_the_frequency_and_differ_in_stability():
    top, bottom = third_order(8.0)
    amplitudes, omegas = np.geomspace(0.01, 30, 200), np.geomspace(0.05, 50, 200)
    saturated = limit_cycles(top, bottom, H, LIMITED, amplitudes, omegas)
    # Beyond a dead zone the loop is unstable: it leaves the cycle, outwards or to rest.
    dead = limit_cycles(top, bottom, H, dead_zone, amplitudes, omegas)
    assert [c.stable for c in saturated] == [True]
    assert [c.stable for c in dead] == [False]
    assert dead[0].frequency_Hz == pytest.approx(saturated[0].frequency_Hz, rel=1e-9)
    z = np.exp(2j * np.pi * saturated[0].frequency_Hz * H)
    loop = control.tf(top, bottom, H)(z)
    assert loop.imag == pytest.approx(0.0, abs=1e-9)
    assert saturation(1.0, np.array(saturated[0].amplitude)) == pytest.approx(-1 / loop.real, rel=1e-9)


@pytest.mark.parametrize(
    ("gain", "nonlinearity", "count"),
    [
        (8.0, control.saturation_nonlinearity(1.0), 1),
        (8.0, control.relay_hysteresis_nonlinearity(1.0, 0.1), 1),
        (4.0, control.friction_backlash_nonlinearity(0.2), 2),
    ],
)
def test_against_the_intersections_of_python_control(gain, nonlinearity, count):
    top, bottom = third_order(gain)
    amplitudes, omegas = np.geomspace(0.1005, 10, 300), np.geomspace(0.05, 50, 600)
    found = limit_cycles(top, bottom, H, of(nonlinearity), amplitudes, omegas)
    response = control.describing_function_response(
        control.tf(top, bottom, H), nonlinearity, amplitudes, omegas, warn_nyquist=False, refine=True
    )
    crossings = sorted(response.intersections)
    assert len(found) == len(crossings) == count
    for cycle, (amplitude, angle) in zip(found, crossings, strict=True):
        # Its refinement minimises a distance, which knows the place to the root of its tolerance.
        assert cycle.amplitude == pytest.approx(amplitude, rel=2e-3)
        assert 2 * np.pi * cycle.frequency_Hz * H == pytest.approx(angle, rel=2e-3)  # it counts in rad a sample


@pytest.mark.parametrize(("describing", "nonlinearity", "third"), [(RELAY, np.sign, 1 / 3), (LIMITED, None, 0.12)])
def test_a_simulated_loop_settles_to_the_predicted_cycle(describing, nonlinearity, third):
    # What is neglected: the third harmonic of the nonlinearity, by its first, comes back through L(3w)/L(w) = 1/14 and
    # turns the zeros of y by third/14 rad. The phase of L falls by 0.94 rad, its gain twofold, per unit of ln w.
    turned = third / 14
    top, bottom = third_order(8.0)
    found = limit_cycles(top, bottom, H, describing, np.geomspace(0.01, 30, 200), np.geomspace(0.05, 50, 200))
    assert len(found) == 1
    assert found[0].stable
    if nonlinearity is None:
        nonlinearity = lambda x: np.clip(x, -1, 1)  # noqa: E731
    for start in (0.3, 2.5):  # from inside and from outside
        amplitude, frequency = cycle_of(simulated(nonlinearity, top, bottom, 16000, start))
        assert frequency == pytest.approx(found[0].frequency_Hz, rel=1.1 * turned / 0.94)
        assert amplitude == pytest.approx(found[0].amplitude, rel=1.1 * 2 * turned / 0.94)


def test_a_simulated_loop_leaves_an_unstable_cycle_to_either_side():
    top, bottom = third_order(8.0)
    found = limit_cycles(top, bottom, H, dead_zone, np.geomspace(0.01, 30, 200), np.geomspace(0.05, 50, 200))
    (cycle,) = found
    dead = lambda x: x - np.clip(x, -0.1, 0.1)  # noqa: E731
    inside = simulated(dead, top, bottom, 6000, 0.3 * cycle.amplitude)
    outside = simulated(dead, top, bottom, 6000, 3.0 * cycle.amplitude)
    assert abs(inside[-1000:]).max() < 0.11
    assert abs(outside[-1000:]).max() > 10.0


def test_a_loop_with_more_than_one_cycle():
    # The quantiser's N falls and rises between its steps: with a loop of -1.2 at half a turn there are pairs.
    def codes(amplitude, omega):
        return quantiser(0.1, amplitude)

    top, bottom = third_order(7.0)
    found = limit_cycles(top, bottom, H, codes, np.geomspace(0.0501, 1, 2000), np.geomspace(0.5, 5, 100))
    level = 1 / abs(control.tf(top, bottom, H)(np.exp(2j * np.pi * found[0].frequency_Hz * H)))
    grid = np.geomspace(0.0501, 1, 200001)
    real = codes(grid, 1.0).real
    passes = np.flatnonzero(np.diff(real > level))
    assert len(found) == passes.size
    np.testing.assert_allclose([c.amplitude for c in found], grid[passes], rtol=2e-5)
    rising = np.diff(real)[passes] > 0
    # More gain makes this loop grow: where N rises with the amplitude the cycle is left.
    assert [c.stable for c in found] == (~rising).tolist()


def test_a_loop_of_little_gain_has_no_cycle():
    top, bottom = third_order(3.0)
    amplitudes, omegas = np.geomspace(0.01, 30, 100), np.geomspace(0.05, 50, 100)
    found = limit_cycles(top, bottom, H, LIMITED, amplitudes, omegas)
    assert len(found) == 0
    assert list(found) == []
    assert found.plot().get_legend() is not None


def test_a_describing_function_of_amplitude_and_frequency():
    # At a cycle 1 + N L = 0 by definition; N is a saturation behind a lag of 0.1 s.
    def lagging(amplitude, omega):
        return saturation(1.0, amplitude) / (1 + 0.1j * omega)

    top, bottom = third_order(5.5)
    found = limit_cycles(top, bottom, H, lagging, np.geomspace(0.01, 30, 300), np.geomspace(0.05, 50, 300))
    assert len(found) >= 1
    for cycle in found:
        omega = 2 * np.pi * cycle.frequency_Hz
        loop = control.tf(top, bottom, H)(np.exp(1j * omega * H))
        assert lagging(np.array(cycle.amplitude), omega) * loop == pytest.approx(-1.0, abs=1e-7)


def test_a_constant_gain_is_described_at_each_amplitude():
    # L = k z^-1 / (1 - z^-1) crosses -180 degrees at half the sampling rate only, so a gain of 0.5 has no cycle.
    found = limit_cycles([0.0, 0.5], [1.0, -1.0], H, lambda amplitude, omega: 0.5, [1.0, 2.0, 3.0], [1.0, 2.0])
    assert len(found) == 0
    np.testing.assert_array_equal(found.describing, np.full(3, 0.5))


def test_the_picture_names_both_curves_and_each_cycle():
    top, bottom = third_order(8.0)
    found = limit_cycles(top, bottom, H, LIMITED, np.geomspace(0.5, 30, 50), np.geomspace(0.05, 50, 200))
    labels = found.plot().get_legend_handles_labels()[1]
    assert labels == [
        "loop L, upper half of the circle",
        "-1/N(A), A from 0.5 to 30",
        "stable, 0.223 Hz, amplitude 1.6",
        "-1",
    ]
