"""Readings of an oscillator in closed form that have another sign, unit or gain than the model's."""

from dataclasses import replace

import numpy as np
import pytest
from oscillator import DAMPING, MASS, STIFFNESS, Oscillator
from scipy.signal import cont2discrete, dlsim

from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.quality.compared import factors, require_same_scale
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import DataError, Plant, Recording

WIDTH, NUMBER = 0.01, 1500
TIME = WIDTH * np.arange(NUMBER)


STAIR = 3.0 * np.floor(TIME / 1.5)
"""Ten steps upwards, each of 0.075 mm."""
SINE = 15.0 * np.sin(2 * np.pi * 5.0 * TIME)


def moved(command: np.ndarray, stiffness: float = STIFFNESS) -> np.ndarray:
    """Exact response to held commands, m."""
    rates, push = np.array([[0, 1], [-stiffness / MASS, -DAMPING / MASS]]), np.array([[0], [1e-3 / MASS]])
    discrete = cont2discrete((rates, push, np.array([[1, 0]]), np.zeros((1, 1))), WIDTH)
    _, motion, _ = dlsim(discrete, np.append(command, 0.0))
    return motion[1:, 0]


def read(command: np.ndarray, motion: np.ndarray, factor: float = 1.0) -> Recording:
    """Readings of a motion times a factor, with noise of 2 µm."""
    noise = 2e-6 * np.random.default_rng(4).standard_normal(NUMBER)
    return Recording.from_arrays(command, factor * (motion + noise), WIDTH)


def recorded(factor: float, stiffness: float = STIFFNESS) -> Recording:
    """Response to commands around 14 Hz."""
    rng = np.random.default_rng(3)
    command = 20.0 * np.sin(np.cumsum(2 * np.pi * 14.0 * WIDTH + 0.1 * rng.standard_normal(NUMBER)))
    return read(command, moved(command, stiffness), factor)


def prepared(recording):
    plant = Plant(rig=Oscillator(sample_time=WIDTH))
    problem, base = prepare(plant, check_quality(plant, recording), ())
    return problem, base.chosen.calibration.plant


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (-1.0, "^recording of 0 to .* the readings fall where those of the model rise"),
        (1e3, "1e\\+03 times the readings of the model"),
        (1e-3, "as if one of them had another unit: 0.001 times"),
    ],
)
def test_another_sign_or_unit_is_an_error(factor, message):
    with pytest.raises(DataError, match=message):
        require_same_scale(*prepared(recorded(factor)))


def test_readings_of_a_calibrated_model_may_have_been_in_antiphase_with_the_nominal_one():
    """Driven at 14 Hz, the nominal oscillator (10 Hz) and one of 20 Hz move in antiphase."""
    problem, calibrated = prepared(recorded(1.0, stiffness=4 * STIFFNESS))
    assert calibrated.parameters["stiffness"].value == pytest.approx(4 * STIFFNESS, rel=0.02)
    assert factors(problem, calibrated) == ()


@pytest.mark.parametrize(("factor", "told"), [(5.0, [5.0]), (3.0, [])])
def test_a_factor_is_told_if_the_plant_explains_less_than_half(factor, told):
    """A plant that reads y where f y is recorded leaves (1 - 1/f)² of the variance: 64 % for f = 5, 44 % for f = 3."""
    problem, _ = prepared(recorded(factor))
    require_same_scale(problem, problem.nominal)
    assert [known for _, known in factors(problem, problem.nominal)] == pytest.approx(told, rel=1e-3)


@pytest.mark.parametrize("drift", [-2.0, -20.0, 20.0])
def test_a_drift_that_exceeds_the_motion_is_no_factor(drift):
    """The command rises in steps while the zero of the sensor drifts, by a multiple of the whole motion, 0.675 mm."""
    motion = moved(STAIR)
    assert factors(*prepared(read(STAIR, motion + drift * np.ptp(motion) * TIME / TIME[-1]))) == ()


def test_a_reversed_sensor_is_found_beside_a_drift():
    motion = moved(STAIR)
    with pytest.raises(DataError, match="the readings fall where those of the model rise: -1 times"):
        require_same_scale(*prepared(read(STAIR, motion - 2 * np.ptp(motion) * TIME / TIME[-1], -1.0)))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0.0, 1e-3])
def test_constant_readings_have_no_factor(value):
    assert factors(*prepared(Recording.from_arrays(STAIR, np.full(NUMBER, value), WIDTH))) == ()


def test_half_a_period_late_is_not_a_reversed_sign():
    """A dead time of 0.1 s is half a period of 5 Hz; a reversed sensor differs from it in the first 0.1 s only."""
    late = np.append(np.zeros(10), moved(SINE)[:-10])
    require_same_scale(*prepared(read(SINE, late)))
    with pytest.raises(DataError, match="fall where those of the model rise"):
        require_same_scale(*prepared(read(SINE, moved(SINE), -1.0)))


def test_a_jump_in_a_gap_is_no_factor():
    """The command rises evenly; the sensor falls by five times the motion where samples are left out."""
    ramp = 20.0 * TIME / TIME[-1]
    motion = moved(ramp)
    recording = read(ramp, motion - np.where(TIME > 7.0, 5 * np.ptp(motion), 0.0))
    problem, calibrated = prepared(recording)
    outside = (np.abs(TIME - 7.0) > 0.5,)
    gap = tuple(replace(part, masks=outside) for part in problem.everything)
    assert factors(replace(problem, everything=gap), calibrated) == ()
