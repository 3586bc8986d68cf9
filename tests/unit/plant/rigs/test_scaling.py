"""Forces and commands of effects in proportion to those that move a rig."""

import json
from dataclasses import dataclass, field, replace

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
    RigError,
    Roll,
    Sizes,
    Stack,
    effect_named,
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


@pytest.mark.parametrize("rig", [Cone(), Roll(), Planar(), Stack(gain=1.0)], ids=lambda rig: rig.kind)
def test_a_saved_plant_keeps_effects_of_the_catalogue_that_the_user_added(rig):
    """A strength within the catalogue's range may be out of the rig's, and other sizes change the equations."""
    for name in ("coulomb_friction", "end_stop", "hysteresis", "amplifier_offset"):
        plant = rig.with_effects(effect_named(name))
        again = Plant.from_dict(json.loads(json.dumps(plant.to_dict())))
        assert again.effects == plant.effects
        assert list(again.parameters.values()) == list(plant.parameters.values())


def test_a_saved_plant_keeps_effects_at_the_sizes_of_another_variant_of_its_rig():
    large = next(effect for effect in Cone(thickness=5e-6).effects() if effect.name == "hysteresis")
    plant = Cone().with_effects(large).with_values({"hysteresis.distance": 5e-3})
    again = Plant.from_dict(plant.to_dict())
    assert list(again.parameters.values()) == list(plant.parameters.values())


@pytest.mark.parametrize("sizes", [{"motion": -1.0}, {"travel": 1.0}, 3.0, None])
def test_malformed_sizes_in_a_file_are_an_error(sizes):
    data = Stack().with_effects(effect_named("hysteresis")).to_dict() | {"sizes": {"hysteresis": sizes}}
    with pytest.raises(RigError, match="sizes"):
        Plant.from_dict(data)


def test_a_file_names_the_effects_of_a_rig():
    rig = Stack()
    friction = next(effect for effect in rig.effects() if effect.name == "coulomb_friction")
    data = rig.with_effects(friction).to_dict()
    assert data["effects"] == ["coulomb_friction"] and "sizes" not in data


@pytest.mark.parametrize(
    "rig", [Pressure(pressure=0.0), Pressure(pressure=1e-3), Cone(mass=0.0)], ids=lambda rig: rig.kind
)
def test_a_flat_film_without_a_load_does_not_move_and_leaves_the_effects_as_they_are(rig):
    """Its force along the motion vanishes by symmetry, and only rounding moves it."""
    usual = {effect.name: effect for effect in Diaphragm().effects()}
    assert all(effect == usual[effect.name] for effect in rig.effects())


def test_a_kind_of_ones_own_states_its_sizes():
    @dataclass(frozen=True, kw_only=True)
    class Mine(Cone):
        kind = "mine"
        sizes = Sizes(force=9.0)

    friction = next(effect for effect in Mine().effects() if effect.name == "coulomb_friction")
    assert friction.force == pytest.approx(1000 * CoulombFriction().force)


def test_a_kind_of_ones_own_may_have_a_field_that_has_no_hash():
    @dataclass(frozen=True, kw_only=True)
    class Mine(Stack):
        kind = "mine"
        notes: list = field(default_factory=list)

    assert Mine().effects() == Stack().effects()


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
