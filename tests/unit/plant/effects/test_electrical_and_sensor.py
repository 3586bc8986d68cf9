"""All electrical and sensor effects: off is off, sensitivities are derivatives, composition has one order."""

from dataclasses import fields, replace

import numpy as np
import pytest

from deatwin.plant.effects.amplifier_offset import AmplifierOffset
from deatwin.plant.effects.amplifier_saturation import AmplifierSaturation
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.charge_injection import ChargeInjection
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.dielectric_absorption import DielectricAbsorption
from deatwin.plant.effects.electrode_loss import ElectrodeLoss
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.leakage import Leakage
from deatwin.plant.effects.sensor_curvature import SensorCurvature
from deatwin.plant.effects.sensor_drift import SensorDrift
from deatwin.plant.effects.sensor_jump import SensorJump
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.effects.sensor_saturation import SensorSaturation
from deatwin.plant.excitation import band_limited_noise

EFFECTS = (
    AmplifierOffset(),
    AmplifierSaturation(limit=2.2e3),
    AmplifierSlew(),
    ChargeInjection(time=3.0),
    Delay(time=0.033),
    DielectricAbsorption(time=2.0),
    ElectrodeLoss(at=1.006),
    ElectrodeRC(),
    Leakage(),
    SensorCurvature(),
    SensorDrift(time=30.0),
    SensorJump(at=1.506),
    SensorLag(),
    SensorSaturation(limit=0.15e-3),
)
NOISE = band_limited_noise(np.random.default_rng(8), 2.4, 0.02)
TOLERANCE = 1e-6  # demanded of each parameter's sensitivity, relative to its rms


def off(effect):
    return replace(effect, **{effect.strength: 0.0})


def reading(plant, experiment):
    return plant.simulate(experiment(NOISE)).require().outputs[0][0]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_an_effect_says_what_it_is(effect):
    assert {p.name for p in effect.describe()} == {f.name for f in fields(effect)}
    assert effect.strength not in effect.shapes
    assert effect.wording.format(**{f.name: "x" for f in fields(effect)})
    strength = next(p for p in effect.describe() if p.name == effect.strength)
    assert strength.lower <= 0.0 <= strength.upper


def test_effects_that_are_off_are_not_there(base, experiment):
    plant = base.with_effects(*map(off, EFFECTS))
    # Newton's last update is below 1e-5 of the scale, what is left below its square: 1e-13 m.
    np.testing.assert_allclose(reading(plant, experiment), reading(base, experiment), rtol=0, atol=1e-12)


CHAINED = tuple(e for e in EFFECTS if e.name != "electrode_loss")  # the bare chain has no film to lose


@pytest.mark.parametrize("effect", CHAINED, ids=lambda e: e.name)
def test_an_effect_that_is_off_is_not_there_among_others(effect, chain):
    others = [e for e in CHAINED if e is not effect]
    without, with_it = (chain(NOISE, *others), chain(NOISE, *others, off(effect)))
    np.testing.assert_allclose(with_it["reading"], without["reading"], rtol=0, atol=1e-12)
    # Newton's method leaves 1e-10 of a kilovolt, and where the corners of a slew limit lie within a sample, a digit or
    # two less: 1e-8 of a squared kilovolt.
    np.testing.assert_allclose(with_it["squared_voltage"], without["squared_voltage"], rtol=1e-8, atol=1e-2)


def central_difference(run, plant, number):
    """Fourth order: (8 D(h) - D(2h))/6 with D(h) = y(p + h) - y(p - h)."""
    values = plant.free_values
    parameter = plant.parameters[plant.parameters.free[number]]
    step = 1e-4 * (abs(parameter.value) or 1e-2 * (parameter.upper - parameter.lower))

    def difference(size):
        up, down = (run(values + sign * size * np.eye(values.size)[number]) for sign in (1, -1))
        return up - down

    return (8 * difference(step) - difference(2 * step)) / (12 * step)


def check_sensitivities(plant):
    options = {"start": -0.4, "sample_time": 0.02, "rest_command": 0.0}

    def run(values):
        return plant.simulator.run(NOISE, values=values, **options).outputs

    exact = plant.simulator.run_with_sensitivities(NOISE, values=plant.free_values, **options)
    np.testing.assert_allclose(exact.outputs, run(plant.free_values), atol=1e-12)
    errors = {}
    for number, parameter in enumerate(plant.parameters.free):
        slope = exact.sensitivities[:, number]
        errors[parameter] = np.linalg.norm(central_difference(run, plant, number) - slope) / np.linalg.norm(slope)
    assert {name: error for name, error in errors.items() if not error < TOLERANCE} == {}


def test_sensitivities_are_the_derivatives(base):
    check_sensitivities(base.with_effects(*EFFECTS))


def test_film_and_drive_keep_evenness_where_they_should(base, experiment):
    odd = {"amplifier_offset", "amplifier_slew"}  # these two tell up from down
    plant = base.with_effects(*(off(e) if e.name in odd else e for e in EFFECTS))
    up, down = (plant.simulate(experiment(sign * NOISE)).require().outputs[0][0] for sign in (1, -1))
    np.testing.assert_allclose(up, down, atol=1e-12)
