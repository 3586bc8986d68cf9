"""Forces and commands of effects in proportion to those that move a rig."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.plant import (
    BlockedPlanar,
    BowTie,
    Cone,
    CoulombFriction,
    Diaphragm,
    Disc,
    Material,
    Parameter,
    Planar,
    Plant,
    Pressure,
    Roll,
    Stack,
)
from deatwin.plant.effects.places import everywhere
from deatwin.plant.effects.sizes import FORCE
from deatwin.plant.laws import VACUUM_PERMITTIVITY, neo_hookean
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.scaling import FIELD, Mounted, stiffness, stroke

RIGS = (
    Diaphragm(),
    Cone(),
    Disc(),
    Planar(),
    Pressure(),
    Roll(),
    Stack(),
    BowTie(),
    Stack(layers=1),
    Cone(spring_rate=1e4),
)


def test_a_spring_adds_its_rate():
    film = Cone()
    plant = Plant(rig=film)
    height = float(rest_state(plant.equations, 0.0, plant.free_values).x[0])
    beside = replace(film, spring_rate=5e3, spring_preload=5e3 * height)  # at the same height it exerts no force
    assert stiffness(beside) - stiffness(film) == pytest.approx(5e3, rel=1e-6)


def test_a_stack_contracts_at_the_usual_field_by_the_maxwell_stress_over_youngs_modulus():
    modulus = Parameter(name="shear_modulus", value=3e6, unit="Pa", lower=1e3, upper=1e7)
    relative = Parameter(name="permittivity", value=2.8, unit="1", lower=1.0, upper=10.0)
    rig = Stack(material=Material(name="mine", energy=neo_hookean, elastic=(modulus,), permittivity=relative), load=0.0)
    length = rig.layers * rig.thickness
    strain = 2.8 * VACUUM_PERMITTIVITY * FIELD**2 / (3 * 3e6)
    film = Mounted(gain=rig.gain, thickness=rig.thickness, size=length)
    assert stroke(rig, film) == pytest.approx(
        strain * length, rel=1e-3
    )  # of the order of the strain at 1 % of the field


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_the_usual_friction_takes_the_same_share_of_the_force_on_every_actuator(rig):
    friction = next(effect for effect in rig.effects() if effect.name == "coulomb_friction")
    size = rig.frame_radius if isinstance(rig, Diaphragm) else rig._size
    stretches = (rig.prestretch,) * 2 if isinstance(rig, Diaphragm) else rig._prestretches
    film = Mounted(gain=rig.gain, thickness=rig.thickness / np.prod(stretches), size=size)
    share = friction.force / (stiffness(rig) * stroke(rig, film))
    assert abs(np.log10(share / (CoulombFriction().force / FORCE))) <= 0.5  # forces are scaled by powers of ten
    lower, upper = (getattr(friction.described("force"), end) for end in ("lower", "upper"))
    assert lower == 0.0 and upper / friction.force == pytest.approx(0.02 / 0.7e-3)


def test_only_lengths_forces_and_commands_are_scaled():
    usual, large = ({effect.name: effect for effect in everywhere(rig.effects())} for rig in (Diaphragm(), Planar()))
    changed = {name for name, effect in large.items() if effect.describe() != usual[name].describe()}
    assert changed >= {"coulomb_friction", "hysteresis", "end_stop", "sensor_drift", "periodic_disturbance_at_force"}
    assert changed.isdisjoint({"creep", "resonance", "delay", "leakage", "amplifier_saturation", "sensor_lag"})
    ours, theirs = (effects["hysteresis"] for effects in (large, usual))
    assert ours.beta == theirs.beta and ours.distance == pytest.approx(100 * theirs.distance)


def test_a_saved_plant_keeps_its_scaled_effects():
    rig, names = Stack(), ("coulomb_friction", "periodic_disturbance_at_force")
    plant = rig.with_effects(*(effect for effect in everywhere(rig.effects()) if effect.name in names))
    again = Plant.from_dict(plant.to_dict())
    assert [again.parameters[name] for name in plant.parameters] == list(plant.parameters.values())


@pytest.mark.parametrize("rig", [Diaphragm, Cone, Planar, BlockedPlanar], ids=lambda rig: rig.kind)
@pytest.mark.parametrize("gain", [1.0, 20.0, 800.0, 2000.0])
def test_an_offset_of_the_amplifier_is_of_the_same_size_at_the_film_whatever_the_gain(rig, gain):
    """With a film voltage as input, the gain is 1, and an offset of 8 V there is as usual as 10 mV before a gain of 800."""
    effects = {effect.name: effect for effect in everywhere(rig(gain=gain).effects())}
    for name, usual in (("amplifier_offset", 8.0), ("periodic_disturbance_at_command", 16.0)):
        effect = effects[name]
        strength = effect.described(effect.strength)
        assert abs(np.log10(gain * strength.value / usual)) <= 0.5
        assert strength.upper / strength.value == pytest.approx({"amplifier_offset": 100.0}.get(name, 50.0))
