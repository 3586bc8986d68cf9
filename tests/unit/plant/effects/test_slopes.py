"""Sensitivities by the parameters of film, ball and environment effects, against differences of simulations."""

import numpy as np
import pytest
from slopes import slope_errors

from deatwin.plant import Diaphragm, Plant
from deatwin.plant.effects.coulomb_friction import CoulombFriction
from deatwin.plant.effects.cubic_stiffness import CubicStiffness
from deatwin.plant.effects.end_stop import EndStop
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.mullins import Mullins
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.permittivity_stretch import PermittivityStretch
from deatwin.plant.effects.prestretch_relaxation import PrestretchRelaxation
from deatwin.plant.effects.quadratic_damping import QuadraticDamping
from deatwin.plant.effects.resonance import Resonance
from deatwin.plant.effects.strain_stiffening import StrainStiffening
from deatwin.plant.effects.thermal_stiffness import ThermalStiffness
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(3), 1.8, 0.02)
SMOOTH = [
    CubicStiffness(),
    PeriodicDisturbance(),
    PermittivityStretch(),
    PrestretchRelaxation(time=20.0),
    QuadraticDamping(),
    Resonance(mass=2e-3),
    StrainStiffening(),
    ThermalStiffness(period=20.0),
]
"""Functions of state and time without corners."""
CORNERED = [CoulombFriction(), CoulombFriction(slip=1e-6), EndStop(), Hysteresis(beta=0.6), Mullins()]
"""Their corners are rounded, but to widths that a difference must stay below: shorter steps, larger errors."""


pytestmark = pytest.mark.usefixtures("uncompiled")


def worst(effect, step):
    """The largest error of the effect's own parameters and of the film's modulus."""
    plant = Plant(rig=Diaphragm(), effects=(effect,))
    own = [name for name in plant.parameters.free if name.startswith(effect.name)]
    errors = slope_errors(plant, NOISE, step, names=[*own, "shear_modulus"])
    return max(errors.values()), errors


@pytest.mark.parametrize("effect", SMOOTH, ids=lambda e: e.name)
def test_slopes_are_exact(effect):
    error, each = worst(effect, 1e-4)
    assert error < 1e-6, each


@pytest.mark.parametrize("effect", CORNERED, ids=lambda e: e.name)
def test_slopes_over_corners_are_those_of_small_steps(effect):
    error, each = worst(effect, 1e-5)
    assert error < 1e-3, each
