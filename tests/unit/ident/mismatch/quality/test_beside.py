"""Readings that are held beside a plant that moves, in a plant whose closed form is known: a first-order lag."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.mismatch.quality.compared import without_faults
from deatwin.ident.mismatch.quality.quality import Soundness, check_quality, faults_of, split
from deatwin.ident.mismatch.quality.suspects import held
from deatwin.plant import Experiment, Planar, Plant, Reading, Recording

STEP, NOISE, SIZE = 0.005, 2e-3, 3000


def holds(rng: np.random.Generator) -> np.ndarray:
    """A command that changes after a tenth of a second on average."""
    levels = rng.uniform(-1.0, 1.0, SIZE)
    return levels[np.cumsum(rng.random(SIZE) < 0.05)]


def lag(command: np.ndarray, time: float = 0.05) -> np.ndarray:
    """Exact response of a first-order lag to held commands: 1 where it is constant and 1."""
    kept = np.exp(-STEP / time)
    return np.asarray(lfilter([0.0, 1.0 - kept], [1.0, -kept], command))


def marked(reading: np.ndarray, simulated: np.ndarray, command: np.ndarray) -> np.ndarray:
    return np.flatnonzero(held(reading, simulated, command, STEP, NOISE))


@pytest.mark.parametrize("last", [1300, SIZE])
def test_a_hold_under_a_brisk_command_is_found_up_to_its_end(last):
    """At least nine of ten draws, to within a second: where the plant is near the value held there is no leap."""
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        command = holds(rng)
        simulated = lag(command)
        reading = simulated + NOISE * rng.standard_normal(SIZE)
        reading[1000:last] += simulated[1000] - simulated[1000:last]
        where = marked(reading, simulated, command)
        found.append(where.size and abs(int(where[0]) - 1000) < 200 and int(where[-1]) == last - 1)
    assert sum(map(bool, found)) >= 9


@pytest.mark.parametrize("samples", [40, 80, 160])
def test_a_hold_of_part_of_a_second_is_found(samples):
    """0.2 to 0.8 s in which the plant moved on by a fifth of its range: at least nine of ten draws, up to the end."""
    found = []
    for seed in range(10):
        rng = np.random.default_rng(50 + seed)
        command = holds(rng)
        simulated = lag(command)
        first = next(k for k in range(1000, 2500) if abs(simulated[k + samples] - simulated[k]) > 0.4)
        reading = simulated + NOISE * rng.standard_normal(SIZE)
        held = slice(first, first + samples)
        reading[held] += simulated[first] - simulated[held]
        where = marked(reading, simulated, command)
        ends = np.flatnonzero(np.diff(where) > 1)
        found.append(where.size and not ends.size and where[0] <= first and where[-1] == first + samples - 1)
    assert sum(map(bool, found)) >= 9


def test_a_strip_that_goes_slack_is_not_held():
    """Its force stays at zero, the end of its range, while a plant that pushes as well as pulls goes on."""
    rng = np.random.default_rng(90)
    command = np.concatenate([np.linspace(0.0, 1.0, SIZE // 2), np.linspace(1.0, -0.3, SIZE - SIZE // 2)])
    simulated = lag(command)
    noise = NOISE * rng.standard_normal(SIZE)
    assert marked(np.maximum(simulated, 0.0) + noise, simulated, command).size == 0
    last = np.arange(SIZE) >= SIZE - 700
    assert marked(np.where(last, simulated[~last][-1], simulated) + noise, simulated, command).size > 600
    lost = np.where(last, simulated.min(), simulated)  # it jumps to the end of its range
    assert marked(lost + noise, simulated, command).size > 600


def friction(command: np.ndarray, level: float) -> np.ndarray:
    """Where a lag comes whose drive must exceed a level before it moves on, and which then lacks it."""
    place, found = 0.0, np.zeros(command.size)
    for k, drive in enumerate(command):
        found[k] = place
        force = drive - place
        place += (1.0 - np.exp(-STEP / 0.05)) * np.sign(force) * max(abs(force) - level, 0.0)
    return found


@pytest.mark.parametrize("physics", ["friction", "stop", "dead time", "lag", "dead zone"])
def test_what_a_plant_does_is_no_hold(physics):
    """The model lacks the physics; commands change slowly enough for long stands."""
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        command = rng.uniform(-1.0, 1.0, SIZE)[np.cumsum(rng.random(SIZE) < 0.005)]
        simulated = lag(command)
        true = {
            "friction": lambda u: friction(u, 0.4),
            "stop": lambda u: np.minimum(lag(u), 0.1),
            "dead time": lambda u: np.concatenate([np.zeros(60), lag(u)[:-60]]),
            "lag": lambda u: lag(u, 0.5),
            "dead zone": lambda u: lag(np.sign(u) * np.maximum(np.abs(u) - 0.4, 0.0)),
        }[physics](command)
        assert not marked(true + NOISE * rng.standard_normal(SIZE), simulated, command).any()


def test_a_current_whose_peaks_come_a_sample_late_is_not_held():
    rng = np.random.default_rng(3)
    command = rng.uniform(-1.0, 1.0, SIZE)[np.cumsum(rng.random(SIZE) < 0.005)]
    simulated = np.diff(lag(command, 0.01), prepend=0.0)
    reading = np.roll(simulated, -1) + NOISE * rng.standard_normal(SIZE)
    assert not marked(reading, simulated, command).any()


def test_missing_values_are_no_hold():
    rng = np.random.default_rng(4)
    command = holds(rng)
    simulated = lag(command)
    reading = simulated + NOISE * rng.standard_normal(SIZE)
    reading[1000:1300] = np.nan
    assert not marked(reading, simulated, command).any()


@pytest.mark.parametrize("row", [0, 1])
def test_a_hold_is_the_fault_of_its_own_reading(row):
    """Beside a sound displacement a capacitance that is held is left out; a displacement that is held makes the verdict."""
    plant = Plant(rig=Planar(noise=2e-6, further=(Reading(name="capacitance", noise=1e-12),)))
    rng = np.random.default_rng(5)
    command = np.repeat(rng.uniform(0.5, 1.5, 100), 10)
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros((0, 1000)), plant.rig.sample_time),))
    (record,) = plant.record(blank, rng).recordings
    spoilt, stretch = np.array(record.outputs), slice(400, 600)
    noise = spoilt[row] - plant.simulate(blank).require().outputs[0][row]
    spoilt[row, stretch] = spoilt[row, 400] + noise[stretch]
    given = check_quality(plant, Experiment(recordings=(replace(record, outputs=spoilt),)))
    checked = without_faults(given, plant)
    (fault,) = faults_of(checked)
    assert fault.fault == f"the {('reading', 'capacitance')[row]} is stuck"
    assert 200 <= fault.samples < 300
    assert checked.soundness is (Soundness.FAULTY, Soundness.SOUND)[row]
    parts = split(checked, weights={"capacitance": 1.0})[2]
    assert [int(part.masks[0][stretch].sum()) for part in parts] == ([0, 200], [200, 0])[row]
