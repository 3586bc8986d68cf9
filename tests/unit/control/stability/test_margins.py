"""Margins against closed forms and python-control; the band of a recording."""

import control
import numpy as np
import pytest
from scipy.optimize import brentq

from deatwin.control.stability.circle import search
from deatwin.control.stability.margins import margins
from deatwin.control.stability.polynomials import in_series

H = 0.02


def test_sampled_integrator_with_a_delay_in_closed_form():
    # L = k z^-2 / (1 - z^-1): |L| = k / (2 sin(x/2)), phase -90° - 1.5 x, with x the angle on the unit circle
    k = np.array([0.02, 0.1, 0.4])
    found = margins(np.outer(k, [0.0, 0.0, 1.0]), np.tile([1.0, -1.0], (3, 1)), H)
    crossover = 2 * np.arcsin(k / 2)
    phase = np.pi / 2 - 1.5 * crossover
    np.testing.assert_allclose(found.crossover, crossover / H, rtol=1e-9)
    np.testing.assert_allclose(found.phase_deg, np.degrees(phase), rtol=1e-9)
    np.testing.assert_allclose(found.delay, phase / crossover * H, rtol=1e-9)
    np.testing.assert_allclose(found.gain, 2 * np.sin(np.pi / 6) / k, rtol=1e-9)
    assert found.stable.all()


def test_crossings_of_two_close_resonances_are_found():
    poles = np.array([0.9998 * np.exp(0.666j), 0.999 * np.exp(0.613j)])
    top = np.array([0.0, 0.0, 5.36783278e-05, -1.68965528e-05])
    bottom = np.convolve(np.poly(np.concatenate([poles, poles.conj()])).real, [1.0, -1.0])
    # |L| exceeds one in less than a thousandth of the band, twice the width of the sharper resonance.
    shift = np.exp(-1j * np.linspace(0.665, 0.668, 300_001))
    loop = np.polyval(top[::-1], shift) / np.polyval(bottom[::-1], shift)
    above = np.flatnonzero(np.abs(loop) > 1.0)
    found = margins(top, bottom, H)
    assert found.stable.all()
    assert found.crossover[0] * H == pytest.approx(0.665 + 1e-8 * above[-1], abs=1e-8)
    assert found.phase_deg[0] == pytest.approx(np.degrees(np.abs(np.angle(-loop[above]))).min(), abs=0.01)


def test_what_grows_by_its_margin_is_at_the_edge():
    rng = np.random.default_rng(3)
    tops = rng.normal(size=(50, 3)) * [0.0, 0.1, 0.1]
    bottoms = np.array([np.poly([1.0, *rng.uniform(-0.9, 0.9, 2)]) for _ in tops])
    found = margins(tops, bottoms, H)
    assert 5 < found.stable.sum() < 50
    sound = found.stable & np.isfinite(found.gain)
    for top, bottom, gain in zip(tops[sound], bottoms[sound], found.gain[sound], strict=True):
        inside = margins([top * 0.999 * gain, top / (0.999 * gain)], [bottom, bottom], H).stable
        outside = margins([top * 1.001 * gain, top / (1.001 * gain)], [bottom, bottom], H).stable
        assert inside.all()
        assert not outside.all()


def test_a_resonance_that_only_comes_close_to_one_is_no_crossing():
    bottom = np.poly([0.95 * np.exp(0.8j), 0.95 * np.exp(-0.8j)]).real
    angle = np.linspace(0.0, np.pi, 20001)
    peak = np.abs(1.0 / np.polyval(bottom, np.exp(1j * angle))).max()
    found = margins([[0.0, 0.98 / peak]], [bottom], H)
    assert found.phase_deg[0] == np.inf
    assert found.crossover[0] == 0.0


def random_loops(rng, count, order, decades=(-2.5, -0.3)):
    """Loops of a few lags and resonances, half of them with an integrator, of so much gain."""
    for _ in range(count):
        resonances = [r * np.exp(1j * a) for r, a in rng.uniform([0.8, 0.1], [0.999, 3.0], (order, 2))]
        poles = [p for r in resonances for p in (r, np.conj(r))] + list(rng.uniform(0.3, 0.98, 3))
        bottom = np.poly(poles).real
        top = np.concatenate([[0.0], rng.normal(size=2)])
        top *= 10 ** rng.uniform(*decades) * abs(bottom.sum() / top.sum())
        if rng.random() < 0.5:
            top, bottom = np.convolve(top, [0.3, -0.27]), np.convolve(bottom, [1.0, -1.0])
        yield np.pad(top, (0, bottom.size - top.size)), bottom


def dense(top, bottom):
    """Measures of a loop in long double, on a grid that is fine about all poles and zeros of what is divided."""
    roots = np.concatenate([np.roots(np.trim_zeros(c, "b")) for c in (bottom, bottom + top, bottom - top)])
    angle = [np.geomspace(1e-6, np.pi - 1e-6, 4001), np.linspace(1e-6, np.pi - 1e-6, 4001)]
    angle += [abs(np.angle(r)) + abs(1 - abs(r)) * np.sinh(np.linspace(-9, 9, 801)) for r in roots if abs(r) > 0]
    angle = np.unique(np.concatenate(angle))
    angle = angle[(angle >= 1e-6) & (angle <= np.pi - 1e-6)].astype(np.longdouble)
    shift = np.cos(angle) - 1j * np.sin(angle)
    n, d = (np.polyval(c[::-1].astype(np.longdouble), shift) for c in (top, bottom))
    return abs(n) - abs(d), (n * d.conj()).imag, abs(n + d) / abs(d), 2 * abs(n + d) / abs(d - n)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_all_crossings_and_sharp_approaches_are_found(order):
    rng = np.random.default_rng(order)
    stable = 0
    for top, bottom in random_loops(rng, 60, order):
        found, places = margins(top, bottom, H), search(top[None], bottom[None])
        level, height, modulus, disk = dense(top, bottom)
        assert places.gain.loops.size == np.count_nonzero((level[1:] > 0) != (level[:-1] > 0))
        assert places.real.loops.size == np.count_nonzero((height[1:] > 0) != (height[:-1] > 0))
        assert not any(np.isnan(v).any() for v in vars(found).values())
        if found.stable[0]:
            stable += 1
            # A grid is above the least; these are fine enough to be so by less than a thousandth.
            for ours, theirs in ((found.modulus[0], modulus.min()), (found.disk[0], disk.min())):
                assert (1 - 1e-3) * theirs < ours < (1 + 1e-9) * theirs
    assert stable > 10


def test_disk_and_modulus_margin_of_a_delayed_gain_in_closed_form():
    # L = k z^-1: |1 + L| is least, 1 - k, at half the sampling rate, and |1 - L| largest there, 1 + k.
    k = np.array([0.1, 0.5, 0.9])
    found = margins(np.outer(k, [0.0, 1.0]), [[1.0]], H)
    np.testing.assert_allclose(found.modulus, 1 - k, rtol=1e-9)
    np.testing.assert_allclose(found.disk, 2 * (1 - k) / (1 + k), rtol=1e-9)
    np.testing.assert_allclose(found.disk_gain, 1 / k, rtol=1e-9)  # where the disk touches on the real axis
    np.testing.assert_allclose(found.gain, 1 / k, rtol=1e-12)  # half the sampling rate counts as a phase crossing
    np.testing.assert_allclose(np.tan(np.radians(found.disk_phase_deg) / 2), (1 - k) / (1 + k), rtol=1e-9)


def polished(loop, guess):
    """A gain crossing near a guess, if there is one, by python-control's evaluation of the loop."""

    def excess(omega):
        return abs(loop(np.exp(1j * omega * H))) - 1

    low, high = guess * (1 - 1e-4), guess * (1 + 1e-4)
    return [brentq(excess, low, high, xtol=1e-14, rtol=1e-15)] if excess(low) * excess(high) < 0 else []


@pytest.mark.parametrize("order", [0, 1])  # of higher ones python-control loses crossings
def test_random_stable_loops_against_python_control(order):
    rng = np.random.default_rng(20 + order)
    compared = 0
    for top, bottom in random_loops(rng, 120, order, (-0.5, 0.7)):
        found = margins(top, bottom, H)
        # Slower crossovers stand for roots near a double one at 1, which python-control loses.
        if not (found.stable[0] and found.crossover[0] * H > 0.05):
            continue
        loop = control.tf(top, bottom, H)
        gains, phases, _, _, crossovers, _ = control.stability_margins(loop, returnall=True, method="poly")
        # Roots near the unit circle count there, and are right to the root of rounding by order: polished, or dropped.
        crossovers = np.array([w for guess in crossovers for w in polished(loop, guess)])
        phases = np.array([np.angle(-loop(np.exp(1j * w * H))) for w in crossovers])
        assert found.phase_deg[0] == pytest.approx(np.degrees(abs(phases).min(initial=np.inf)), rel=1e-9)
        ahead = np.mod(phases, 2 * np.pi) / np.where(crossovers > 0, crossovers, 1.0)
        assert found.delay[0] == pytest.approx(ahead.min(initial=np.inf), rel=1e-9)
        gains = np.append(gains, [-1 / loop(z).real for z in (1.0, -1.0) if np.isfinite(loop(z)) and loop(z).real < 0])
        factors = np.maximum(gains, 1 / gains)
        # What is near the circle only may lie lower; the margin itself must be among them.
        assert found.gain[0] >= factors.min(initial=np.inf) * (1 - 1e-9)
        if np.isfinite(found.gain[0]):
            assert abs(factors / found.gain[0] - 1).min() < 1e-8
        compared += 1
    assert compared > 5


@pytest.mark.parametrize("lags", [3, 4])
def test_slow_lags_close_together_keep_their_crossings(lags):
    """Equal lags of 40 s at 50 Hz: of four the denominator at the crossing is 1e-14 of its coefficients."""
    pole, static = 0.9995, 2.0
    top = np.append(np.zeros(lags), static * (1 - pole) ** lags)
    found = margins(top, np.poly([pole] * lags), H)
    # |e^jw - p|^2 = 1 + p^2 - 2 p cos w is (1 - p)^2 static^(2/lags) at the gain crossing; its phase is lags times that
    # of e^jw - p, which at the phase crossing is pi/lags: sin(pi/lags - w) = p sin(pi/lags).
    turn = 2 * np.arcsin(np.sqrt((static ** (2 / lags) - 1) / pole) * (1 - pole) / 2)
    phase = np.pi - lags * np.arctan2(np.sin(turn), np.cos(turn) - pole)
    turned = np.pi / lags - np.arcsin(pole * np.sin(np.pi / lags))
    gain = (abs(np.exp(1j * turned) - pole) / (1 - pole)) ** lags / static
    # Half a unit in the last place of each coefficient against the denominator where it is smallest, |e^jw - p|^lags.
    rounding = 0.5 * np.finfo(float).eps * (1 + pole) ** lags / (1 - pole) ** lags
    assert found.stable[0]
    assert found.gain[0] == pytest.approx(gain, rel=rounding)
    assert found.phase_deg[0] == pytest.approx(np.degrees(phase), abs=np.degrees(rounding))


def test_families_are_multiplied_and_keep_their_axes():
    rng = np.random.default_rng(4)
    plants, controllers = rng.normal(size=(3, 1, 5, 2)) * 0.1, rng.normal(size=(2, 1, 3))
    loops = in_series(plants, controllers)
    assert loops.shape == (3, 2, 5, 4)
    np.testing.assert_allclose(loops[2, 1, 3], np.convolve(plants[2, 0, 3], controllers[1, 0]), atol=1e-15)
    found = margins(loops, [1.0, -0.5], H)
    assert found.gain.shape == found.disk_gain.shape == (3, 2, 5)
    single = margins(loops[1, 0, 4], [1.0, -0.5], H)
    assert single.disk[0] == pytest.approx(found.disk[1, 0, 4], rel=1e-12)


def test_loops_of_no_gain_have_all_margins_that_there_are():
    found = margins([[0.0, 0.0]], [[1.0, -0.5]], H)
    assert found.gain[0] == found.phase_deg[0] == found.delay[0] == np.inf
    assert found.modulus[0] == pytest.approx(1.0)
    assert found.disk[0] == pytest.approx(2.0)  # S = 1, T = 0
    assert found.stable[0]


def test_a_static_loop_has_a_gain_margin_to_minus_one_and_none_at_it():
    found = margins([[-0.5], [-2.0], [0.5], [-1.0]], [1.0], H)
    np.testing.assert_allclose(found.gain, [2.0, 2.0, np.inf, 0.0])
    assert found.stable.tolist() == [True, True, True, False]
    assert not any(np.isnan(v).any() for v in vars(found).values())


@pytest.mark.filterwarnings("error")
def test_a_lag_of_unit_gain_at_rest_has_every_delay_margin():
    # L = z^-1/(2 - z^-1) is 1 at 0 Hz and smaller above, so no delay makes it -1; L = -1/3 at half the sampling rate.
    found = margins([0.0, 1.0], [2.0, -1.0], 1.0)
    assert found.stable[0] and np.isinf(found.delay[0])
    np.testing.assert_allclose([found.gain[0], found.phase_deg[0]], [3.0, 180.0], rtol=1e-12)


def test_an_integrator_that_a_zero_cancels_leaves_the_loop_unstable():
    # The pole at 1 is not moved by the feedback: (1 - z^-1)(1 + 0.1 z^-1) closed.
    found = margins([[0.0, 0.1, -0.1]], [[1.0, -1.0, 0.0]], H)
    assert not found.stable[0]
    assert found.gain[0] == found.phase_deg[0] == found.delay[0] == found.disk[0] == 0.0


def test_stability_agrees_with_the_roots_near_the_unit_circle():
    rng = np.random.default_rng(9)
    polynomials, expected = [], []
    for distance in np.repeat(10.0 ** -np.arange(2, 10), 20):
        outside = rng.random() < 0.5
        first = (1 + distance if outside else 1 - distance) * np.exp(1j * rng.uniform(0.5, 2.5))
        others = rng.uniform(-0.9, 0.9, 4)
        polynomials.append(np.poly([first, first.conj(), *others]).real)
        expected.append(not outside)
    polynomials = np.array(polynomials)
    # As closed loops: the numerator is what the denominator lacks.
    found = margins(polynomials - [1.0, 0, 0, 0, 0, 0, 0], [1.0], H)
    assert found.stable.tolist() == expected
