"""Amplifier and dead time, on a bare chain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.plant.effects.amplifier_offset import AmplifierOffset
from deatwin.plant.effects.amplifier_saturation import AmplifierSaturation
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.delay import Delay
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(4), 4.0, 0.02)
GAIN = 800.0


def test_an_offset_is_added_to_the_command(chain):
    np.testing.assert_allclose(
        chain(NOISE, AmplifierOffset(offset=0.02))["film_voltage"], GAIN * (NOISE + 0.02), rtol=1e-14
    )


def test_an_offset_breaks_evenness_and_mirrors_with_its_sign(base, experiment):
    def reading(sign, offset):
        plant = base.with_effects(AmplifierOffset(offset=offset))
        done = plant.simulate(experiment(sign * NOISE)).require()
        return done.watched[0]["displacement"]  # relative to rest, where the offset acts too

    np.testing.assert_allclose(reading(1, 0.05), reading(-1, -0.05), atol=1e-12)
    # To first order the branches differ by y(u + u0) - y(u - u0), y going at least with the square of u.
    difference, there = reading(1, 0.05) - reading(-1, 0.05), reading(1, 0.0)
    assert np.all(difference[100:] > 0.9 * 4 * 0.05 / NOISE.max() * there[100:])


def test_a_clipped_voltage_is_untouched_below_and_flat_above(chain):
    asked = np.linspace(-4.0, 4.0, 81)
    got = chain(asked, AmplifierSaturation(limit=2e3))["film_voltage"]
    # Softplus: what is left of the corner at a distance d is w exp(-d/w).
    below = np.abs(GAIN * asked) < 1.7e3
    np.testing.assert_allclose(got[below], GAIN * asked[below], atol=2 * 20 * np.exp(-300 / 20))
    above = np.abs(GAIN * asked) > 2.3e3
    np.testing.assert_allclose(got[above], 2e3 * np.sign(asked[above]), atol=2 * 20 * np.exp(-300 / 20))
    np.testing.assert_allclose(got, -got[::-1], atol=1e-9)


def test_a_bent_voltage_keeps_a_share_of_the_excess(chain):
    got = chain(np.full(3, 4.0), AmplifierSaturation(limit=2e3, share=0.25))["film_voltage"]
    np.testing.assert_allclose(got, 2e3 + 0.75 * 1.2e3, rtol=1e-9)


def slewed(effect, commands, sample_time=0.02):
    """The rate limit as an ordinary differential equation, sample by sample."""
    volts, ends = 0.0, []

    def rate(_, v, target):
        x = target - v
        size = np.where(x > 0, x, x / effect.ratio)
        width = effect.width * (1 + 1 / effect.ratio)
        width /= np.hypot(1, effect.slowness * width / effect.lag)
        return x / (effect.slowness * np.hypot(width, size))

    for u in commands:
        done = solve_ivp(rate, (0, sample_time), [volts], args=(GAIN * u,), method="LSODA", rtol=1e-8, atol=1e-6)
        volts = done.y[0, -1]
        ends.append(volts)
    return np.array(ends)


def test_a_rate_limit_agrees_with_an_integration(chain):
    effect = AmplifierSlew(slowness=1e-4, ratio=0.2)
    commands = np.concatenate([np.full(10, 2.0), np.full(60, 1.0), NOISE])
    got = chain(commands, effect)["amplifier_voltage"]
    # At a corner within a sample polynomials of degree 5 are some 0.28/5 off half of a sample's way (Bernstein's
    # constant for |x|), which is 200 V at 10 kV/s.
    np.testing.assert_allclose(got, slewed(effect, commands), atol=0.28 / 5 / 2 * 200)


def test_rising_and_falling_rates_are_those_of_the_parameters(chain):
    effect = AmplifierSlew(slowness=4e-4, ratio=0.2)
    got = chain(np.concatenate([np.full(100, 3.0), np.zeros(100)]), effect)["amplifier_voltage"]
    assert np.diff(got)[5] / 0.02 == pytest.approx(1 / 4e-4, rel=1e-4)  # 1/sqrt(1 + (w/x)²), x > 1.5 kV
    assert np.diff(got)[110] / 0.02 == pytest.approx(-0.2 / 4e-4, rel=1e-4)


def test_no_slowness_passes_the_voltage(chain):
    got = chain(NOISE, AmplifierSlew(slowness=0.0))["amplifier_voltage"]
    np.testing.assert_allclose(got, GAIN * NOISE, rtol=1e-12)


@pytest.mark.parametrize("slowness", np.geomspace(1e-9, 4e-3, 12))
def test_a_rate_limit_is_solved_for_all_rates(chain, slowness):
    steps = np.repeat([0.0, 3.0, -3.0, 0.5, 3.5, 0.0], 10)
    effect = AmplifierSlew(slowness=slowness, ratio=0.1)
    got = chain(steps, effect)["amplifier_voltage"]
    # The best polynomial of degree n on [-1, 1] is 0.28/n off |x| (Bernstein): where the voltage catches up within
    # a sample, five stages overshoot by about 0.28/5 of half the jump, for that sample.
    assert np.abs(got).max() < GAIN * (3.5 + 0.28 / 5 / 2 * 6.0)
    if slowness < 1e-7:
        # What is left is a lag of T = slowness * width (1 + 1/ratio) far below a sample h, of which Radau's stability
        # function with s stages leaves s T/h of the step.
        lag = slowness * effect.width * 11
        np.testing.assert_allclose(got, GAIN * steps, atol=5 * lag / 0.02 * GAIN * 6.0 + 1e-9)


@pytest.mark.parametrize("samples", [0, 1, 2, 5])
@pytest.mark.parametrize("sample_time", [0.02])
def test_a_delay_of_whole_samples_shifts_the_command(chain, samples, sample_time):
    got = chain(NOISE, Delay(time=samples * sample_time), sample_time=sample_time)["acting_command"]
    shifted = np.concatenate([np.zeros(samples), NOISE])[: NOISE.size]
    np.testing.assert_allclose(got, shifted, atol=1e-13)


def test_a_delay_between_samples_mixes_two_neighbours(chain):
    got = chain(NOISE, Delay(time=0.03))["acting_command"]
    before = np.concatenate([[0.0, 0.0], NOISE])
    np.testing.assert_allclose(got, (before[1:-1] + before[:-2]) / 2, atol=1e-13)


def test_a_delay_has_the_phase_of_its_time(chain):
    times = 0.02 * np.arange(400)
    frequency, delay = 1.0, 0.033
    got = chain(np.sin(2 * np.pi * frequency * times), Delay(time=delay))["acting_command"][100:]
    transfer = 2 * np.mean(got * np.exp(-2j * np.pi * frequency * times[100:])) * 1j
    # Mixing neighbours at 50 samples a period: amplitude 1 - (pi/50)²/2 at most, phase third order in 2 pi/50.
    assert np.angle(transfer) == pytest.approx(-2 * np.pi * frequency * delay, abs=2e-3)
    assert abs(transfer) == pytest.approx(1.0, abs=2e-3)


def test_a_delay_has_a_continuous_slope_across_whole_samples(chain):
    step = 1e-6

    def slope(time):
        up, down = (chain(NOISE, Delay(time=time + d))["acting_command"] for d in (step, 0.0))
        return (up - down) / step

    # The rounded ramp has a second derivative of 2/0.25 at its corner; a sharp one would change its slope by `bend`.
    change = np.abs(slope(0.04) - slope(0.04 - step)).max()
    bend = np.abs(np.diff(np.concatenate([np.zeros(2), NOISE]), n=2)).max() / 0.02
    assert change < 1.1 * 2 / 0.25 * bend * step / 0.02
    assert np.abs(slope(0.0)).max() > 0.1  # seen to first order when off


def test_delay_and_offset_commute(chain):
    both = chain(NOISE, Delay(time=0.04), AmplifierOffset(offset=0.1))["acting_command"]
    np.testing.assert_allclose(both[2:], NOISE[:-2] + 0.1, atol=1e-13)


def test_a_falling_source_delays_only_falling_parts(chain):
    wave = 2.0 - np.cos(2 * np.pi * 0.5 * 0.02 * np.arange(300))
    effect = AmplifierSlew(slowness=1e-4, ratio=0.1)  # 10 kV/s up, 1 kV/s down; the wave has 2.5 kV/s
    ends = {r: chain(wave, replace(effect, ratio=r))["amplifier_voltage"] for r in (0.1, 1.0)}
    behind, late = (ends[r][50:] - GAIN * wave[50:] for r in (0.1, 1.0))
    assert behind.max() > 200.0
    # Within a sample the lag of 2 ms leaves exp(-10) of the command's step of 50 V.
    assert np.abs(late).max() < 1.0
    rising = np.diff(wave[49:]) > 0
    assert np.abs(behind[rising & (wave[50:] > 2.5)]).max() < 1.0
