"""All electrical and sensor effects together: sensitivities are derivatives."""

import numpy as np
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


def test_sensitivities_are_the_derivatives(base):
    errors = slope_errors(base.with_effects(*EFFECTS), NOISE, 1e-4, share=1e-2)
    assert {name: error for name, error in errors.items() if not error < TOLERANCE} == {}
