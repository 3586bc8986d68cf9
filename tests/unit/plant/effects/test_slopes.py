"""Sensitivities by the parameters of the catalogue's effects on the diaphragm, against differences of simulations."""

import numpy as np
import pytest
from slopes import slope_errors

from deatwin.plant import Diaphragm, Effect, Plant, catalogue
from deatwin.plant.effects.amplifier_offset import AmplifierOffset
from deatwin.plant.effects.amplifier_saturation import AmplifierSaturation
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.charge_injection import ChargeInjection
from deatwin.plant.effects.coulomb_friction import CoulombFriction
from deatwin.plant.effects.creep import Creep
from deatwin.plant.effects.cubic_stiffness import CubicStiffness
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.dielectric_absorption import DielectricAbsorption
from deatwin.plant.effects.electrode_loss import ElectrodeLoss
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.end_stop import EndStop
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.leakage import Leakage
from deatwin.plant.effects.mullins import Mullins
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.effects.permittivity_stretch import PermittivityStretch
from deatwin.plant.effects.prestretch_relaxation import PrestretchRelaxation
from deatwin.plant.effects.quadratic_damping import QuadraticDamping
from deatwin.plant.effects.resonance import Resonance
from deatwin.plant.effects.sensor_curvature import SensorCurvature
from deatwin.plant.effects.sensor_drift import SensorDrift
from deatwin.plant.effects.sensor_jump import SensorJump
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.effects.sensor_saturation import SensorSaturation
from deatwin.plant.effects.strain_stiffening import StrainStiffening
from deatwin.plant.effects.thermal_stiffness import ThermalStiffness
from deatwin.plant.excitation import band_limited_noise

SMOOTH = (
    CubicStiffness(),
    PeriodicDisturbance(),
    PermittivityStretch(),
    PrestretchRelaxation(time=20.0),
    QuadraticDamping(),
    Resonance(mass=2e-3),
    StrainStiffening(),
    ThermalStiffness(period=20.0),
)
"""Functions of state and time without corners."""
FIRST = (Creep(), PermittivityDrift(), ElectrodeRC(), Hysteresis())
ELECTRICAL = (
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
CORNERED = [CoulombFriction(), CoulombFriction(slip=1e-6), EndStop(), Hysteresis(beta=0.6), Mullins()]
"""Their corners are rounded, but to widths that a difference must stay below: shorter steps, larger errors."""


def test_every_effect_of_the_catalogue_is_tried():
    tried = (*SMOOTH, *FIRST, *ELECTRICAL, *CORNERED)
    assert {effect.name for effect in catalogue()} == {effect.name for effect in tried}


@pytest.mark.parametrize(
    ("effects", "step", "tolerance"),
    [
        pytest.param((), 5e-5, 1e-6, id="none"),
        pytest.param(SMOOTH, 1e-4, 1e-6, id="smooth"),
        # Larger steps would smear the kinks of friction where the motion turns.
        pytest.param(FIRST, 5e-5, 1e-6, id="first"),
        pytest.param(ELECTRICAL, 1e-4, 1e-6, id="electrical"),
        *(pytest.param((effect,), 1e-5, 1e-3, id=effect.name) for effect in CORNERED),
    ],
)
def test_slopes_are_those_of_small_steps(effects: tuple[Effect, ...], step: float, tolerance: float) -> None:
    """Of an effect that is not felt the slope is zero, and its relative error no number."""
    plant = Plant(rig=Diaphragm(), effects=effects)
    own = [name for effect in effects for name in plant.parameters.free if name.startswith(effect.name)]
    names = None if effects in ((), FIRST) else [*own, "shear_modulus", "permittivity"]
    share = 1e-2 if effects is ELECTRICAL else 1e-3
    commands = band_limited_noise(np.random.default_rng(8), 2.4 if tolerance == 1e-6 else 1.2, 0.02)
    errors = slope_errors(plant, commands, step, share=share, names=names)
    assert {name: error for name, error in errors.items() if not error < tolerance} == {}
