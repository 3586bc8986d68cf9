"""A plant that moves faster than its samples is simulated with more stages, or its error is told."""

import logging
import re

import numpy as np
import pytest

from deatwin.plant import Plant, ReadingTime
from deatwin.plant.resolution import mode_error, resolved

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
    assert followed.stages > plant.stages
    assert error(followed) < 0.1 * plant.rig.noise


def test_a_slow_plant_keeps_its_stages(oscillator, experiment) -> None:
    plant = ringing(oscillator, 0.25 * 2 * np.pi / STEP)
    assert mode_error(plant) < 1e-5
    assert resolved(plant, [experiment(np.linspace(0.0, 60.0, 50))]) is plant


def test_a_constant_command_needs_no_more_stages(oscillator, experiment) -> None:
    plant = ringing(oscillator, 0.8 * 2 * np.pi / STEP)
    assert resolved(plant, [experiment(np.zeros(50))]) is plant


def test_what_no_number_of_stages_follows_is_told(oscillator, experiment, caplog: pytest.LogCaptureFixture) -> None:
    """The motion of a step, 60 N on 9e4 N/m, rings for many samples, at ten times their rate: 0.67 mm."""
    plant = Plant(rig=oscillator(sample_time=10 * STEP), values={"stiffness": 9e4})
    held = experiment(np.repeat([0.0, 60.0], 20), sample_time=10 * STEP)
    with caplog.at_level(logging.WARNING):
        assert resolved(plant, [held]) is plant
    told = re.search("the position is simulated with an error of up to ([0-9.]+) µm", caplog.text)
    assert told is not None
    assert 100.0 < float(told[1]) < 2 * 667.0
