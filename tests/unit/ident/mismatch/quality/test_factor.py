"""Readings of an oscillator in closed form that have another sign, unit or gain than the model's."""

import numpy as np
import pytest
from oscillator import DAMPING, MASS, STIFFNESS, Oscillator
from scipy.signal import cont2discrete, dlsim

from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.quality.factor import factors, require_same_scale
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import DataError, Plant, Recording

WIDTH, NUMBER = 0.01, 1500
TIME = WIDTH * np.arange(NUMBER)


def recorded(factor: float, stiffness: float = STIFFNESS) -> Recording:
    """Exact response to held commands around 14 Hz, times a factor, with noise of 2 µm."""
    rng = np.random.default_rng(3)
    command = 20.0 * np.sin(np.cumsum(2 * np.pi * 14.0 * WIDTH + 0.1 * rng.standard_normal(NUMBER)))
    rates, push = np.array([[0, 1], [-stiffness / MASS, -DAMPING / MASS]]), np.array([[0], [1e-3 / MASS]])
    discrete = cont2discrete((rates, push, np.array([[1, 0]]), np.zeros((1, 1))), WIDTH)
    _, motion, _ = dlsim(discrete, np.append(command, 0.0))
    return Recording.from_arrays(command, factor * (motion[1:, 0] + 2e-6 * rng.standard_normal(NUMBER)), WIDTH)


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
