"""Margins against closed forms and python-control; the band of a recording."""

import control
import numpy as np
import pytest

from deatwin.control import excited_band, margins
from deatwin.plant import DataError, Recording

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


@pytest.mark.parametrize("delay", [2, 3, 7])
def test_first_order_and_delay_under_pi_against_python_control(delay):
    pole = np.exp(-H / 0.3)
    plant = np.concatenate([np.zeros(delay), [1 - pole]])
    top, bottom = np.convolve(plant, [0.9 + 2.0 * H, -0.9]), np.convolve([1.0, -pole], [1.0, -1.0])
    size = max(top.size, bottom.size)
    loop = control.tf(np.pad(top, (0, size - top.size)), np.pad(bottom, (0, size - bottom.size)), H)
    # All crossings: python-control may count the integrator itself as one, with a margin of about zero.
    gains, phases, _, _, crossovers, _ = control.stability_margins(loop, returnall=True, method="poly")
    found = margins(top, bottom, H)
    assert found.gain[0] == pytest.approx(gains[gains > 1.0].min(), rel=1e-9)
    assert found.phase_deg[0] == pytest.approx(phases.min(), rel=1e-9)
    assert found.delay[0] == pytest.approx((np.radians(phases) / crossovers).min(), rel=1e-9)
    assert found.stable[0]


def test_half_the_sampling_rate_counts_as_a_phase_crossing():
    # L = k / (z - 1) is -k/2 there, and the closed loop z - 1 + k is stable up to k = 2.
    assert margins([[0.0, 0.5]], [[1.0, -1.0]], H).gain[0] == pytest.approx(4.0, rel=1e-12)


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


def test_margins_of_an_unstable_loop_are_zero():
    found = margins([[0.0, 3.0]], [[1.0, -1.0]], H)
    assert not found.stable[0]
    assert found.gain[0] == found.phase_deg[0] == found.delay[0] == 0.0


def test_excited_band(recording):
    assert excited_band(recording) == pytest.approx(1.0, abs=0.05)
    with pytest.raises(DataError, match="constant"):
        excited_band(Recording.from_arrays(np.ones(100), np.zeros(100), H))
