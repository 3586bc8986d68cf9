"""Sensitivities by the parameters of film, ball and environment effects, against differences of simulations."""

import numpy as np
import pytest

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

NOISE = band_limited_noise(np.random.default_rng(3), 3.0, 0.02)
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


def outputs(plant, values):
    run = plant.simulator.run(NOISE, start=-0.4, sample_time=0.02, rest_command=0.0, values=values)
    assert run.status.ok
    return run.outputs


def difference(plant, number, relative):
    """Fourth order: (8 D(h) - D(2h))/(12 h) with D(h) = y(p + h) - y(p - h)."""
    values = plant.free_values
    parameter = plant.parameters[plant.parameters.free[number]]
    step = relative * (abs(parameter.value) or 1e-3 * (parameter.upper - parameter.lower))
    shift = step * np.eye(values.size)[number]
    once = outputs(plant, values + shift) - outputs(plant, values - shift)
    twice = outputs(plant, values + 2 * shift) - outputs(plant, values - 2 * shift)
    return (8 * once - twice) / (12 * step)


def errors(effect, relative):
    plant = Plant(rig=Diaphragm(), effects=(effect,))
    exact = plant.simulator.run_with_sensitivities(
        NOISE, start=-0.4, sample_time=0.02, rest_command=0.0, values=plant.free_values
    )
    own = [n for n, name in enumerate(plant.parameters.free) if name.startswith(effect.name)]
    for number in [*own, plant.parameters.free.index("shear_modulus")]:
        slope = exact.sensitivities[:, number]
        found = np.linalg.norm(difference(plant, number, relative) - slope)
        yield plant.parameters.free[number], found / np.linalg.norm(slope)


@pytest.mark.parametrize("effect", SMOOTH, ids=lambda e: e.name)
def test_slopes_are_exact(effect):
    for name, error in errors(effect, 1e-3):
        assert error < 1e-6, f"{name}: {error:.1e}"


@pytest.mark.parametrize("effect", CORNERED, ids=lambda e: e.name)
def test_slopes_over_corners_are_those_of_small_steps(effect):
    for name, error in errors(effect, 1e-5):
        assert error < 1e-3, f"{name}: {error:.1e}"
