"""A plant that moves faster than its samples is simulated in more steps, or its error is told."""

import logging
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_rigs import Pushed

from deatwin.plant import (
    CoulombFriction,
    Delay,
    Effect,
    Experiment,
    Parameter,
    Plant,
    ReadingTime,
    SensorJump,
    StartProcedure,
)
from deatwin.plant.builder import Builder
from deatwin.plant.resolution import followed_plant, free_modes, mode_error, resolved

pytestmark = pytest.mark.usefixtures("uncompiled")

STEP, DECAY = 0.02, 40.0  # s, 1/s: of a mass of 1 kg


def exactly(commands: np.ndarray, frequency: float) -> np.ndarray:
    """Positions at the ends of the samples: free oscillations about the equilibrium of each held force, from rest."""
    stiffness = frequency**2 + DECAY**2
    cosine, sine = np.cos(frequency * STEP), np.sin(frequency * STEP)
    away, rate, found = 0.0, 0.0, []
    for k, force in enumerate(commands):
        level, before = force / stiffness, commands[k - 1] / stiffness if k else 0.0
        away += before - level
        other = (rate + DECAY * away) / frequency
        away, rate = (
            np.exp(-DECAY * STEP) * (away * cosine + other * sine),
            np.exp(-DECAY * STEP)
            * ((other * frequency - DECAY * away) * cosine - (away * frequency + DECAY * other) * sine),
        )
        found.append(level + away)
    return np.array(found)


def ringing(oscillator, frequency: float, reading: ReadingTime = ReadingTime.END_OF_HOLD) -> Plant:
    return Plant(
        rig=oscillator(noise=1e-6, reading=reading), values={"damping": 2 * DECAY, "stiffness": frequency**2 + DECAY**2}
    )


@pytest.mark.parametrize("reading", [ReadingTime.END_OF_HOLD, ReadingTime.START_OF_HOLD])
def test_a_mode_faster_than_the_samples_is_followed(oscillator, experiment, reading: ReadingTime) -> None:
    """Its frequency is 0.8 of the sampling rate, as of a stack with a mass of 200 g at 100 samples per second."""
    frequency = 0.8 * 2 * np.pi / STEP
    commands = np.repeat(np.random.default_rng(1).uniform(0.0, 60.0, 30), 5)
    plant, held = ringing(oscillator, frequency, reading), experiment(commands)
    truth = exactly(commands, frequency)
    if reading is ReadingTime.START_OF_HOLD:
        truth = np.append(0.0, truth[:-1])

    def error(one: Plant) -> float:
        return float(np.abs(one.simulate(held).outputs[0][0] - truth).max())

    assert error(plant) > plant.rig.noise  # five stages are too few: noise would not hide it
    followed = resolved(plant, [held])
    assert followed.steps > 1
    assert error(followed) < 0.1 * plant.rig.noise


def test_friction_that_reverses_within_a_sample_is_followed(experiment) -> None:
    """A sliding mass under held forces, each larger than its friction: parabolas, one of them up to the reversal."""
    mass, friction, push = 3e-3, 0.5e-3, 6e-3
    rng = np.random.default_rng(3)
    commands = rng.choice([-1.0, 1.0], 60) * rng.uniform(0.2, 0.5, 60)
    position, velocity, truth = 0.0, 0.0, []
    for force in push * commands:
        left = STEP
        if velocity * force < 0.0:
            slows = (force - friction * np.sign(velocity)) / mass
            stops = min(-velocity / slows, left)
            position += velocity * stops + slows * stops**2 / 2
            velocity, left = velocity + slows * stops, left - stops
        speeds = (force - friction * np.sign(velocity if left == 0.0 else force)) / mass
        position += velocity * left + speeds * left**2 / 2
        velocity += speeds * left
        truth.append(position)
    free, held = Plant(rig=Pushed(mass=mass, damping=0.0, stiffness=0.0, push=push)), experiment(commands)
    sliding = free.with_effects(CoulombFriction(force=friction, slip=5e-8))
    followed, _ = followed_plant(sliding, [held])
    errors = [np.sqrt(np.mean((one.simulate(held).outputs[0][0] - truth) ** 2)) for one in (sliding, followed)]
    # Where a force jumps within a step, the error is of first order: 32 steps leave about a thirtieth.
    assert followed.steps == 32 and errors[1] < errors[0] / 10
    assert followed_plant(sliding, [held], hidden=4.0 * float(errors[0])) == (sliding, 0.0)
    assert resolved(free, [held]) is free
    _, told = followed_plant(replace(sliding, steps=32), [held])
    assert told == pytest.approx(followed_plant(sliding, [held])[1], rel=0.5)
    late = sliding.with_effects(Delay(time=0.0137).placed("reading"))
    assert followed_plant(late, [held])[0].steps > 1


def test_a_slow_plant_keeps_its_steps(oscillator, experiment) -> None:
    plant = ringing(oscillator, 0.25 * 2 * np.pi / STEP)
    assert mode_error(free_modes(plant), plant.stages) < 1e-5
    assert resolved(plant, [experiment(np.linspace(0.0, 60.0, 50))]) is plant


def test_a_constant_command_needs_no_more_steps(oscillator, experiment) -> None:
    plant = ringing(oscillator, 0.8 * 2 * np.pi / STEP)
    assert resolved(plant, [experiment(np.zeros(50))]) is plant


PUSHED = Plant(
    rig=Pushed(noise=1e-7),
    values={"mass": 0.01, "damping": 0.02 * DECAY, "stiffness": 0.01 * (0.8 * 2 * np.pi / STEP) ** 2},
)
STEPS = np.repeat([0.0, 12.0, 4.0, 10.0], 12)  # V, of 6 mN each: the mass rings by some 100 µm


@pytest.mark.parametrize("effect", [SensorJump(change=1e-4, at=0.395), Delay(time=0.013).placed("reading")])
def test_an_effect_that_depends_on_the_samples_is_no_error(
    experiment, effect: Effect, caplog: pytest.LogCaptureFixture
) -> None:
    """The jump of a reading lasts a part of a sample, and a late reading is stored a sample at a time."""
    held = experiment(STEPS)
    needed = resolved(PUSHED, [held]).steps
    assert needed > 1
    assert resolved(PUSHED.with_effects(effect), [held]).steps == needed
    assert "simulated with an error" not in caplog.text


def test_a_start_by_steps_is_no_error(experiment, caplog: pytest.LogCaptureFixture) -> None:
    """A ramp is held over each sample, and the mass still rings from it when the recording begins."""

    class Ramped(Pushed):
        @property
        def start(self) -> StartProcedure:
            return StartProcedure(ramp=0.1)

    held = experiment(10.0 + STEPS)
    assert resolved(PUSHED.with_rig(Ramped(noise=1e-7)), [held]).steps == resolved(PUSHED, [held]).steps
    assert "simulated with an error" not in caplog.text


def test_a_recording_may_begin_a_little_off_the_clock(experiment) -> None:
    first = experiment(STEPS).recordings[0]
    both = Experiment(recordings=(first, replace(first, start=first.end + 10.008 * STEP)))
    assert resolved(PUSHED, [both]).steps > 1


def test_a_part_without_inertia_changes_no_mode(oscillator) -> None:
    class Doubled(oscillator):
        @property
        def parameters(self) -> tuple[Parameter, ...]:
            return (*super().parameters, Parameter(name="inertia", value=0.0, unit="s", lower=0.0, upper=1.0))

        def write(self, build: Builder) -> Any:
            position = super().write(build)
            doubled = build.state("doubled", scale=1e-2)
            build.rate(doubled, 2 * position - doubled, mass=build.parameter("inertia"))
            return doubled

    alone = ringing(oscillator, 0.8 * 2 * np.pi / STEP)
    error, error_alone = (
        mode_error(free_modes(plant), plant.stages) for plant in (Plant(rig=Doubled(), values=alone.values), alone)
    )
    assert error == pytest.approx(error_alone, rel=1e-6)


def test_more_steps_per_sample_follow_faster_modes(oscillator) -> None:
    """A mode at eight times the sampling rate turns by half a revolution in each of sixteen steps."""
    plant = Plant(rig=oscillator(sample_time=10 * STEP), values={"stiffness": (0.8 * 2 * np.pi / STEP) ** 2})
    errors = [mode_error(free_modes(plant), plant.stages, steps) for steps in (1, 16, 32)]
    assert errors[0] > 0.5
    assert errors[1] < 0.1
    assert errors[2] < errors[1] / 2**8  # The order of five stages is nine.


def test_what_no_number_of_steps_follows_is_told(oscillator, experiment, caplog: pytest.LogCaptureFixture) -> None:
    """The motion of a step, 60 N on 9e4 N/m, rings for many samples, at thirty times their rate: 0.67 mm."""
    plant = Plant(rig=oscillator(sample_time=30 * STEP), values={"stiffness": 9e4})
    held = experiment(np.repeat([0.0, 60.0], 20), sample_time=30 * STEP)
    with caplog.at_level(logging.WARNING):
        assert resolved(plant, [held]) is plant
    told = re.search("the position is simulated with an error of up to ([0-9.]+) µm", caplog.text)
    assert told is not None
    assert 100.0 < float(told[1]) < 2 * 667.0


def test_more_steps_that_do_not_suffice_are_used_where_they_help(
    oscillator, experiment, caplog: pytest.LogCaptureFixture
) -> None:
    """At 16 times the sampling rate; the motion of a step, 60 N on 1.6e4 N/m, is 4 mm, and the noise a nanometre."""
    frequency, slow = 0.4 * 2 * np.pi / STEP, 40 * STEP
    rig = oscillator(sample_time=slow, noise=1e-9)
    plant = Plant(rig=rig, values={"damping": 8.0, "stiffness": frequency**2 + 4.0**2})
    commands = np.repeat([0.0, 60.0], 10)
    with caplog.at_level(logging.WARNING):
        used = resolved(plant, [experiment(commands, sample_time=slow)])
    away, factor = -60.0 / (frequency**2 + 16.0), np.exp((-4.0 + 1j * frequency) * slow)
    after = 1.0 + 4.0 / (1j * frequency)  # of an oscillation from rest, its complex amplitude
    truth = -away + away * np.real(after * factor ** np.arange(1, 11))
    errors = [
        np.abs(one.simulate(experiment(commands, sample_time=slow)).outputs[0][0][10:] - truth).max()
        for one in (plant, used)
    ]
    assert errors[1] < 0.1 * errors[0]
    told = re.search("with an error of up to ([0-9.]+) nm", caplog.text)
    assert told is not None
    assert float(told[1]) == pytest.approx(1e9 * errors[1], rel=0.05)
