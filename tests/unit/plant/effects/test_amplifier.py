"""Amplifier and dead time, on a bare chain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from deatwin.plant import BlockedPlanar, Coupon, Diaphragm, Plant
from deatwin.plant.effects.amplifier_offset import AmplifierOffset
from deatwin.plant.effects.amplifier_saturation import AmplifierSaturation
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.sensor_drift import SensorDrift
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.errors import RigError
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(4), 4.0, 0.02)
GAIN = 800.0

pytestmark = pytest.mark.usefixtures("uncompiled")


def test_an_offset_is_added_to_the_command(chain):
    np.testing.assert_allclose(
        chain(NOISE, AmplifierOffset(offset=0.02))["film_voltage"], GAIN * (NOISE + 0.02), rtol=1e-14
    )


@pytest.mark.parametrize("width", [20.0, 300.0])
def test_the_corner_of_a_clip_has_a_width(chain, width):
    asked = np.linspace(-4.0, 4.0, 81)
    got = chain(asked, AmplifierSaturation(limit=2e3, share=0.8, rounding=width))["film_voltage"]
    over, under = (width * np.logaddexp(0, (side * GAIN * asked - 2e3) / width) for side in (1, -1))
    np.testing.assert_allclose(got, GAIN * asked - 0.8 * (over - under), atol=1e-9 * 2e3)


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


@pytest.mark.parametrize("samples", [0, 1, 2, 5, 15])
def test_a_delay_of_whole_samples_shifts_the_command(chain, samples):
    got = chain(NOISE, Delay(time=0.02 * samples))["acting_command"]
    shifted = np.concatenate([np.zeros(samples), NOISE])[: NOISE.size]
    np.testing.assert_allclose(got, shifted, atol=1e-13)


def test_a_delay_between_samples_mixes_two_neighbours_for_who_follows_at_once(chain):
    got = chain(NOISE, Delay(time=0.03))["acting_command"]
    before = np.concatenate([[0.0, 0.0], NOISE])
    np.testing.assert_allclose(got, (before[1:-1] + before[:-2]) / 2, atol=1e-13)


@pytest.mark.parametrize(("samples", "sample_time"), [(3, 0.025), (43, 0.001), (9, 1 / 300)])
def test_a_delay_that_is_whole_but_for_rounding_is_one(chain, samples, sample_time):
    """0.075 s / 0.025 s is 3 - 4e-16."""
    got = chain(NOISE, Delay(time=samples * sample_time), sample_time=sample_time)["acting_command"]
    np.testing.assert_allclose(got[samples:], NOISE[:-samples], atol=1e-9)  # 1e-10 of a sample of a few volts


def test_a_delay_outside_of_its_range_is_the_nearest_to_first_order():
    off, longest = (film(FILM.with_effects(Delay(time=t)), STAIRS).outputs for t in (0.0, 0.1))
    late = FILM.with_effects(Delay())
    place = late.parameters.free.index("delay.time")

    def beyond(time):
        values = late.free_values.copy()
        values[place] = time
        return late.simulator.run(STAIRS, start=12.345, sample_time=0.02, rest_command=1.0, values=values).outputs

    # 1e-9 s of a motion that reaches some 0.1 m/s
    np.testing.assert_allclose(beyond(-1e-9), off, rtol=0, atol=1e-9)
    np.testing.assert_allclose(beyond(0.14), beyond(0.12), rtol=0, atol=1e-12)
    np.testing.assert_allclose(beyond(0.1), longest, rtol=0, atol=1e-12)


FILM = Plant(rig=Diaphragm())
STAIRS = np.repeat(np.random.default_rng(3).uniform(1.2, 3.2, 8), 12)
FROM_ZERO = np.repeat(np.resize([0.0, 3.0], 8), 12)
REVERSALS = STAIRS * np.repeat(np.resize([1.0, -1.0], 8), 12)


def film(plant, commands, sample_time=0.02):
    """The run of a film that was at rest under 1 V."""
    return plant.simulator.run(
        commands, start=12.345, sample_time=sample_time, rest_command=1.0, values=plant.free_values
    )


def shifted_by_quarters(plant, commands, quarters):
    """What a plant reads under a command that is late by so many quarters of a sample, in four samples for each."""
    finer = np.concatenate([np.full(quarters, 1.0), np.repeat(commands, 4)])[: 4 * commands.size]
    return film(replace(plant, rig=Diaphragm(sample_time=0.005)), finer, 0.005).outputs[4::4]


FOLLOWED = 6e-9
"""m. A step of a whole sample follows a jump to 0.003 µm (`STAGES`), one of a quarter as well, and so their difference
is no larger than both."""


@pytest.mark.parametrize(
    ("commands", "quarters"),
    [*((STAIRS, quarters) for quarters in (1, 4, 6)), (REVERSALS, 1), (FROM_ZERO, 7), (NOISE, 6)],
    ids=["1", "4", "6", "reversals", "from 0 V", "noise"],
)
def test_a_delay_between_samples_is_one_of_whole_shorter_samples(commands, quarters):
    late = film(FILM.with_effects(Delay(time=quarters * 0.005)), commands).outputs[1:]
    assert np.abs(late - shifted_by_quarters(FILM, commands, quarters)).max() < FOLLOWED


@pytest.mark.parametrize("quarters", [3, 4])
def test_the_clock_runs_as_it_does_in_shorter_samples_beside_a_delay(quarters):
    """A tone of 5 Hz turns by 36 degrees in a sample, all along which a lag follows it."""
    shaken = FILM.with_effects(PeriodicDisturbance(amplitude=20e-6, frequency=5.0), SensorLag(time=0.01))
    late = film(shaken.with_effects(Delay(time=quarters * 0.005)), STAIRS).outputs[1:]
    exact = shifted_by_quarters(shaken, STAIRS, quarters)
    assert np.abs(late - exact).max() < FOLLOWED
    assert np.abs(exact - shifted_by_quarters(FILM, STAIRS, quarters)).max() > 1e3 * FOLLOWED  # it does shake


@pytest.mark.parametrize("time", [0.0, 0.015])
def test_beside_a_delay_a_lag_of_no_time_is_none(time):
    late = FILM.with_effects(Delay(time=time))
    lags = ElectrodeRC(time=0.0), SensorLag(time=0.0)
    same = film(late.with_effects(*lags), STAIRS).outputs
    # Newton's method leaves 1e-10 of a millimetre.
    np.testing.assert_allclose(same, film(late, STAIRS).outputs, rtol=0, atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.005])
def test_a_rig_that_starts_late_by_the_clock_reads_the_same_before_the_first_command(time):
    drifting = FILM.with_effects(SensorDrift(change=50e-6, time=20.0))
    first = [film(plant, STAIRS[:1]).outputs[0] for plant in (drifting, drifting.with_effects(Delay(time=time)))]
    np.testing.assert_allclose(first[1], first[0], rtol=0, atol=1e-12)
    assert abs(first[0] - film(FILM, STAIRS[:1]).outputs[0]) > 1e-6


@pytest.mark.parametrize("plant", [Plant(rig=Coupon()), Plant(rig=BlockedPlanar())], ids=["coupon", "blocked"])
@pytest.mark.parametrize("time", [0.012, 0.06])
def test_a_dead_time_is_found_from_elsewhere_where_the_reading_follows_at_once(plant, time):
    late = plant.with_effects(Delay())
    rest = plant.rig.start.rest_command
    commands, place = rest + 0.2 * NOISE, late.parameters.free.index("delay.time")

    def readings(at):
        values = late.free_values.copy()
        values[place] = at
        return late.simulator.run(commands, start=0.0, sample_time=0.02, rest_command=rest, values=values).outputs

    wanted = readings(time)
    scale = np.std(wanted)
    found = least_squares(lambda at: (readings(at[0]) - wanted) / scale, 0.03, x_scale=0.01, bounds=(0.0, 0.1))
    assert found.x[0] == pytest.approx(time, abs=1e-6)


class _Second(Delay):
    name = "second_delay"


def test_a_sample_is_divided_once():
    with pytest.raises(RigError, match="two effects divide a sample"):
        _ = FILM.with_effects(Delay(time=0.03), _Second(time=0.01)).equations


def delay_slope(time):
    plant = FILM.with_effects(Delay(time=time))
    run = plant.simulator.run_with_sensitivities(
        STAIRS, start=12.345, sample_time=0.02, rest_command=1.0, values=plant.free_values
    )
    return run.sensitivities[:, plant.parameters.free.index("delay.time")]


def test_the_slope_of_a_delay_of_whole_samples_lies_between_those_on_either_side():
    before, at, after = (delay_slope(0.02 + d) for d in (-1e-7, 0.0, 1e-7))
    assert np.linalg.norm(at - (before + after) / 2) < 1e-3 * np.linalg.norm(at)


def test_a_delay_that_is_off_is_seen_to_first_order():
    off, nearly = delay_slope(0.0), delay_slope(1e-6)
    assert np.linalg.norm(off - nearly) < 1e-3 * np.linalg.norm(nearly)
