"""Periods, what differs between them, and loops that are told from the distortion of an input that repeats itself."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from deatwin.ident.narx.long_arx import answer_chance
from deatwin.ident.narx.repeats import period_of, periods_apart, whole_period_of
from deatwin.plant.excitation import random_odd_harmonics, random_phase_multisine

STEP, N = 0.01, 400
LAGS = 40
LOOP = 1e-3


def multisine(rng, periods, band=20.0):
    harmonics, _ = random_odd_harmonics(rng, N * STEP, band)
    return random_phase_multisine(rng, N * STEP, STEP, harmonics, 0.6, 0.0, periods=periods, lower=-9.0, upper=9.0)


def chance(u, y):
    scaled = [(one - one.mean()) / one.std() for one in (u, y)]
    return answer_chance([(scaled[0][None], scaled[1])], 0, LAGS)


def distorted(rng, u):
    """A resonance, a cube behind it, and a little noise."""
    x = lfilter([0.2, 0.1], [1.0, -1.3, 0.5], u)
    return x + 0.3 * x**3 + 0.005 * rng.normal(size=u.size)


@pytest.mark.parametrize("kind", ["exact", "read with noise", "not on the clock"])
def test_odd_distortion_of_a_periodic_input_is_no_loop(kind):
    # Where the input repeats itself exactly nothing is left to answer. With noise the chance of one is 1 in 1000: at most
    # one of 12 leaves a chance of 7e-5 that the test fails.
    seen = 0
    for seed in range(12):
        rng = np.random.default_rng([seed, 1])
        u = multisine(rng, 4, 6.0 if kind == "not on the clock" else 20.0)
        if kind == "not on the clock":  # a period of 398.7 samples
            u = CubicSpline(np.arange(u.size), u)(np.arange(1590) * 1.0033)
        y = distorted(rng, u)
        seen += chance(u + 0.01 * rng.normal(size=u.size) * (kind == "read with noise"), y) < LOOP
    assert seen <= (0 if kind == "exact" else 1)


def test_holds_of_equal_length_under_which_the_output_rings_are_no_loop():
    """A tenth of critical damping at 4 Hz, holds of 0.25 s: the ringing tells when the next one begins. At most 1 of 20."""
    w, suspected = 2 * np.pi * 4.0, 0
    (b,), a, _ = cont2discrete(([w**2], [1.0, 0.2 * w, w**2]), STEP)
    for seed in range(20):
        rng = np.random.default_rng([seed, 5])
        u = np.repeat(rng.uniform(0.0, 3.0, 160), 25)
        suspected += chance(u, lfilter(b, a, u**2) + 0.02 * rng.normal(size=u.size)) < LOOP
    assert suspected <= 1


@pytest.mark.parametrize("late", [0, 1])  # samples after which the controller answers
@pytest.mark.parametrize("noise", [0.1, 0.01])
def test_a_loop_with_a_periodic_reference_is_found(late, noise):
    for seed in range(3):
        rng = np.random.default_rng([seed, 2])
        r = multisine(rng, 4)
        e = lfilter([1.0], [1.0, -0.9], noise * rng.normal(size=r.size))
        u, x, y, total = np.zeros(r.size), np.zeros(r.size), np.zeros(r.size), 0.0
        for k in range(3, r.size):
            x[k] = 0.9 * x[k - 1] + 0.1 * u[k - 3]
            y[k] = x[k] + 0.3 * x[k] ** 3 + e[k]
            total += 0.02 * (r[k - late] - y[k - late])
            u[k] = 0.8 * (r[k - late] - y[k - late]) + total
        assert chance(u, y) < LOOP


def test_what_repeats_is_in_the_first_series_alone():
    rng = np.random.default_rng(3)
    u = multisine(rng, 5)
    noise = rng.normal(size=u.size)
    repeated, *others = periods_apart(u, u[None], u**3 + noise, LAGS)
    assert period_of(u) == N and len(others) == 4 and repeated[0].shape == (1, N)
    np.testing.assert_allclose(repeated[0][0], np.sqrt(5) * u[:N], atol=1e-9)
    for inputs, _ in others:
        np.testing.assert_allclose(inputs, 0.0, atol=1e-9)
    # The matrix is orthonormal: the power of the whole is that of the parts.
    assert sum(float(y @ y) for _, y in (repeated, *others)) == pytest.approx(float(np.sum((u**3 + noise) ** 2)))


def test_what_does_not_repeat_or_repeats_within_the_lags_is_left_whole():
    rng = np.random.default_rng(4)
    for u in (rng.normal(size=500), np.sin(np.arange(500) * 2 * np.pi / 25)):
        ((inputs, output),) = periods_apart(u, u[None], 2 * u, LAGS)
        np.testing.assert_array_equal(inputs[0], u)
        np.testing.assert_array_equal(output, 2 * u)


@pytest.mark.parametrize(
    ("period", "whole"), [(3.7, 37), (6.37, None), (20.37, None), (25.0, 25), (40.5, 81), (100.37, None)]
)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_period_is_found_between_samples_and_is_no_multiple(period, whole, noise):
    rng = np.random.default_rng(5)
    tone = np.sin(2 * np.pi * np.arange(4000) / period) + noise * rng.normal(size=4000)
    # The last comparison is half the record later, and with noise a sample off at most.
    assert period_of(tone) == pytest.approx(period, rel=1 / 2000)
    if whole is not None:
        assert whole_period_of(tone) == whole
    several = sum(np.cos(2 * np.pi * h * np.arange(4000) / (40 * period) + h**2) for h in (1, 3, 5, 7))
    if 80 * period < 4000:
        assert period_of(several) == pytest.approx(40 * period, rel=1 / 1000)


def test_noise_a_walk_and_a_ramp_have_no_period():
    noise = np.random.default_rng(6).normal(size=4000)
    assert [period_of(one) for one in (noise, np.cumsum(noise), np.arange(4000.0))] == [None] * 3
