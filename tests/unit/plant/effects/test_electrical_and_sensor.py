"""All electrical and sensor effects: off is off, sensitivities are derivatives, composition has one order."""

from dataclasses import fields, replace

import numpy as np
import pytest
from slopes import slope_errors

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


def test_sensitivities_are_the_derivatives(base):
    errors = slope_errors(base.with_effects(*EFFECTS), NOISE, 1e-4, share=1e-2)
    assert {name: error for name, error in errors.items() if not error < TOLERANCE} == {}


def test_film_and_drive_keep_evenness_where_they_should(base, experiment):
    odd = {"amplifier_offset", "amplifier_slew"}  # these two tell up from down
    plant = base.with_effects(*(off(e) if e.name in odd else e for e in EFFECTS))
    up, down = (plant.simulate(experiment(sign * NOISE)).require().outputs[0][0] for sign in (1, -1))
    np.testing.assert_allclose(up, down, atol=1e-12)
