"""A reading that comes late, against the closed form of a first-order lag under held commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from lag import GAIN, HOLD, TIME, Lag, level, mean

from deatwin.ident.greybox import Part, calibrate
from deatwin.plant import Builder, Delay, Effect, Experiment, Place, Plant, ReadingTime, Recording
from deatwin.plant.small_signal import small_signals

pytestmark = pytest.mark.usefixtures("uncompiled")
NAME = "delay_at_reading.time"
DELAYS = [0.0, 0.1 * HOLD, 0.93 * HOLD, HOLD, 1.4 * HOLD, 2.0 * HOLD, 2.7 * HOLD]
SINE = np.sin(2 * np.pi * 0.7 * HOLD * np.arange(200))
AWAY = 2 * GAIN
"""Furthest distance of a level from the one that a command leads to."""
INTERPOLATION = (HOLD / TIME) ** 5 / 15120
"""Error of a polynomial through the five nodes of Radau IIA, for an exponential: of (t/T)^5/5!, at most 2/252, where
2 and 1/252 are the largest values of P5 - P4 on [-1, 1] and of the monic polynomial's factor on [0, 1]."""


def late(time: float) -> Effect:
    return replace(Lag.sizes.of(Delay()), time=time).placed("reading")


def plant(time: float, reading: ReadingTime = ReadingTime.END_OF_HOLD) -> Plant:
    return Lag(reading=reading).with_effects(late(time))


def given(command: np.ndarray) -> Experiment:
    return Experiment(recordings=(Recording.from_arrays(command, np.zeros(command.size), HOLD),))


def ends(command: np.ndarray) -> np.ndarray:
    return HOLD * np.arange(1, command.size + 1)


@pytest.mark.parametrize("time", DELAYS)
def test_a_held_sine_behind_a_lag(time: float) -> None:
    expected, _ = level(ends(SINE) - time, SINE, GAIN, TIME, HOLD)
    simulated = plant(time).simulate(given(SINE)).require().outputs[0][0]
    whole = abs(time / HOLD - round(time / HOLD)) < 1e-9
    assert np.abs(simulated - expected).max() < (1e-9 if whole else AWAY * INTERPOLATION)


@pytest.mark.parametrize("time", [delay for delay in DELAYS if delay % HOLD])
def test_its_derivative_by_the_delay_is_the_rate(time: float) -> None:
    """The polynomial's error has at most 0.2 for a slope, at the beginning of a sample: the sum of 1/c_i over 126."""
    _, rate = level(ends(SINE) - time, SINE, GAIN, TIME, HOLD)
    there = plant(time)
    run = there.runner.run_with_sensitivities(**there.given(there.timeline(given(SINE))))
    slopes = run.sensitivities[1:, there.parameters.free.index(NAME)]
    assert np.abs(slopes + rate).max() < AWAY / HOLD * (HOLD / TIME) ** 5 / 120 * 0.2


@pytest.mark.parametrize("tenths", [3, 10, 17])
def test_means_over_the_hold_come_late_by_parts_of_it(tenths: int) -> None:
    # A mean that comes 0.3 samples late is one of rows ten times finer, shifted by three of them.
    command = np.concatenate([[0.0], np.random.default_rng(0).normal(size=59)])
    fine = mean(np.repeat(command, 10), GAIN, TIME, HOLD / 10)
    expected = np.concatenate([np.zeros(tenths), fine])[: fine.size].reshape(-1, 10).mean(axis=1)
    simulated = plant(tenths * HOLD / 10, ReadingTime.MEAN_OVER_HOLD).simulate(given(command)).require().outputs[0][0]
    assert np.abs(simulated - expected).max() < 2 * GAIN * np.ptp(command) * INTERPOLATION


@pytest.mark.parametrize("reading", [ReadingTime.END_OF_HOLD, ReadingTime.MEAN_OVER_HOLD])
def test_linearised_about_rest_it_answers_a_small_step_alike(reading: ReadingTime) -> None:
    there = plant(1.4 * HOLD, reading)
    (small,) = small_signals(there, [1.0])
    assert small is not None and small.static_gain == pytest.approx(GAIN)
    state, answer = np.zeros(len(small.a)), []
    for _ in range(30):
        answer.append(float(small.c @ state + small.d[0]))
        state = small.a @ state + small.b[:, 0]
    stepped = there.simulate(given(np.ones(30))).require().outputs[0][0]  # a linear plant: any step is small
    np.testing.assert_allclose(answer, stepped, atol=1e-8)


@dataclass(frozen=True, kw_only=True)
class Wire(Lag):
    """What it reads is its command."""

    reading: ReadingTime = ReadingTime.END_OF_HOLD
    kind: ClassVar[str] = "wire"
    follows_at_once: ClassVar[bool] = True

    def write(self, build: Builder) -> Any:
        return build.place(Place.SENSOR, "reading", build.parameter("gain") * build.command)


def test_a_reading_without_dynamics_is_the_mean_of_two_weighted_by_the_delay() -> None:
    there = Wire().with_effects(late(1.4 * HOLD))
    simulated = there.simulate(given(SINE)).require().outputs[0][0]
    one, two = (np.concatenate([np.zeros(lag), SINE])[: SINE.size] for lag in (1, 2))
    np.testing.assert_allclose(simulated, GAIN * (0.6 * one + 0.4 * two), atol=1e-9)


def test_a_controller_meets_the_same_delay() -> None:
    there = plant(1.4 * HOLD)
    stepper = there.simulator.stepper(there.free_values, rest_command=0.0, start=0.0, sample_time=HOLD)
    seen = []
    for command in SINE:
        stepper.advance(float(command))
        seen.append(stepper.reading)
    np.testing.assert_allclose(seen, there.simulate(given(SINE)).require().outputs[0][0], atol=1e-12)


def test_intervals_of_a_delay_hold_the_true_one() -> None:
    """Intervals of 95 % hold in 36 of 40 or more with a probability of 0.95, those of 80 % with one of 0.08. They are
    narrower than the error of an approximant that rounds the corners of the command: h²/12T, 2.6 ms.
    """
    rng, hits, time = np.random.default_rng(5), 0, 1.4 * HOLD
    command = rng.normal(size=100)
    exact, _ = level(ends(command) - time, command, GAIN, TIME, HOLD)
    for _ in range(40):
        readings = exact + 0.02 * rng.standard_normal(command.size)
        record = Recording.from_arrays(command, readings, HOLD)
        found = calibrate(plant(1.2 * HOLD), [Part.whole(Experiment(recordings=(record,)))], starts=1)
        low, high = found.interval(NAME)
        assert high - low < HOLD**2 / (12 * TIME)
        hits += low <= time <= high
    assert hits >= 36
