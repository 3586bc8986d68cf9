"""Rows that are means over their holds, against closed forms of a first-order lag."""

from __future__ import annotations

import numpy as np
import pytest
from lag import GAIN, HOLD, TIME, Lag, mean
from rig_files import SOUND

from deatwin.ident.greybox.filter_openings import places
from deatwin.plant import Delay, Diaphragm, Experiment, Plant, Reading, ReadingTime, Recording
from deatwin.plant.decimation import decimate
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.small_signal import small_signals

pytestmark = pytest.mark.usefixtures("uncompiled")


def commands(count: int = 300) -> np.ndarray:
    return np.concatenate([[0.0], np.random.default_rng(0).normal(size=count - 1)])


def given(command: np.ndarray, hold: float = HOLD) -> Experiment:
    return Experiment(recordings=(Recording.from_arrays(command, np.zeros(command.size), hold),))


def test_the_mean_of_an_exponential() -> None:
    command = commands()
    simulated = Plant(rig=Lag()).simulate(given(command)).require().outputs[0][0]
    np.testing.assert_allclose(simulated, mean(command, GAIN, TIME), atol=1e-9)


def test_its_derivatives() -> None:
    plant, command, step = Plant(rig=Lag()), commands(), 1e-5
    slopes = plant.runner.run_with_sensitivities(**plant.given(plant.timeline(given(command)))).sensitivities
    by_gain = (mean(command, GAIN + step, TIME) - mean(command, GAIN - step, TIME)) / (2 * step)
    by_time = (mean(command, GAIN, TIME + step) - mean(command, GAIN, TIME - step)) / (2 * step)
    np.testing.assert_allclose(slopes[1:], np.column_stack([by_gain, by_time]), atol=1e-6)


def test_further_readings_are_means_too() -> None:
    plant = Plant(rig=Lag(further=(Reading(name="displacement", unit="1", noise=1e-3),)))
    first, further = plant.simulate(given(commands())).require().outputs[0]
    np.testing.assert_allclose(further, first, atol=1e-12)


def test_a_dead_time_of_part_of_a_sample() -> None:
    # A command that is 0.3 samples late is one of a clock that is ten times finer and shifted by three of its rows.
    command = commands(60)
    fine = np.concatenate([np.zeros(3), np.repeat(command, 10)[:-3]])
    expected = mean(fine, GAIN, TIME, HOLD / 10).reshape(-1, 10).mean(axis=1)
    plant = Plant(rig=Lag(), effects=(Delay(time=0.3 * HOLD),))
    np.testing.assert_allclose(plant.simulate(given(command)).require().outputs[0][0], expected, atol=1e-8)


def test_linearised_about_rest() -> None:
    (small,) = small_signals(Plant(rig=Lag()), [1.0])
    assert small is not None
    assert small.reading == pytest.approx(GAIN) and small.static_gain == pytest.approx(GAIN)
    lost = TIME / HOLD * (1 - np.exp(-HOLD / TIME))  # of the first mean after a step
    assert small.d[0] == pytest.approx(GAIN * (1 - lost)) and small.c == pytest.approx([lost, 0.0])


def test_means_of_a_drive_that_moves_within_the_rows() -> None:
    # A staircase of means moves an integrator rightly by the end of each row; within it a straight drive leads, by
    # w u h^2 / 12 on average: (w h)^2 / 12 of the motion, and less where the plant is faster.
    hold, omega, many, settled = HOLD, 2 * np.pi * 0.8, 400, 20
    time = hold / many * (np.arange(120 * many) + 0.5)
    drive = np.sin(omega * time)
    expected = mean(drive, GAIN, TIME, hold / many).reshape(-1, many).mean(axis=1)[settled:]
    held = given(drive.reshape(-1, many).mean(axis=1))
    simulated, ended = (
        Plant(rig=Lag(reading=reading)).simulate(held).require().outputs[0][0][settled:]
        for reading in (ReadingTime.MEAN_OVER_HOLD, ReadingTime.END_OF_HOLD)
    )
    size = np.abs(expected).max()
    assert np.abs(simulated - expected).max() < (omega * hold) ** 2 / 12 * size
    assert np.abs(ended - expected).max() > 0.4 * omega * hold * size  # half a row late


def test_decimated_rows_are_means_of_means() -> None:
    command = np.repeat(commands(60), 10)
    fine = Recording.from_arrays(command, mean(command, GAIN, TIME, HOLD / 10), HOLD / 10)
    made = decimate(fine, 10, reading=ReadingTime.MEAN_OVER_HOLD)
    np.testing.assert_allclose(made.outputs[0], mean(commands(60), GAIN, TIME), atol=1e-12)
    assert (made.n_samples, made.start, made.sample_time) == (60, 0.0, pytest.approx(HOLD))


def test_no_unknown_input_enters_the_integral() -> None:
    assert "state.reading_integral" not in [opening.name for opening in places(Plant(rig=Lag()))]


def test_a_rig_file_and_a_saved_plant_say_so() -> None:
    stated = {**SOUND, "sensor": {**SOUND["sensor"], "reading": "mean over the hold"}}
    rig = Diaphragm.from_rig_file(RigFile.from_dict(stated))
    assert rig.reading is ReadingTime.MEAN_OVER_HOLD
    assert Diaphragm.from_dict(rig.to_dict()) == rig
