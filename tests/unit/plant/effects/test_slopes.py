"""Sensitivities by the parameters of the catalogue's effects on the diaphragm, against differences of simulations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from slopes import slope_errors

from deatwin.plant import Diaphragm, Effect, Plant, catalogue, effect_named
from deatwin.plant.excitation import band_limited_noise


def named(*names: str, **changed: dict[str, Any]) -> tuple[Effect, ...]:
    return tuple(replace(effect_named(name), **changed.get(name, {})) for name in (*names, *changed))


SMOOTH = named(
    *("cubic_stiffness", "periodic_disturbance", "permittivity_stretch", "quadratic_damping", "strain_stiffening"),
    prestretch_relaxation={"time": 20.0},
    resonance={"mass": 2e-3},
    thermal_stiffness={"period": 20.0},
)
"""Functions of state and time without corners."""
FIRST = named("creep", "permittivity_drift", "electrode_rc", "hysteresis")
ELECTRICAL = named(
    *("amplifier_offset", "amplifier_slew", "electrode_rc", "leakage", "sensor_curvature", "sensor_lag"),
    amplifier_saturation={"limit": 2.2e3},
    charge_injection={"time": 3.0},
    delay={"time": 0.033},
    dielectric_absorption={"time": 2.0},
    electrode_loss={"at": 1.006},
    sensor_drift={"time": 30.0},
    sensor_jump={"at": 1.506},
    sensor_saturation={"limit": 0.15e-3},
)
CORNERED = (
    *named("coulomb_friction", "end_stop", "mullins", hysteresis={"beta": 0.6}),
    *named(coulomb_friction={"slip": 1e-6}),
)
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
