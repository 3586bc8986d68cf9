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
    Planar,
    Plant,
    Pressure,
    Roll,
    Stack,
)
from deatwin.plant.effects.places import everywhere
from deatwin.plant.effects.sizes import FORCE, MOTION
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.scaling import stiffness

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


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_the_usual_friction_holds_back_micrometres_on_every_actuator(rig):
    friction = next(effect for effect in rig.effects() if effect.name == "coulomb_friction")
    held = friction.force / stiffness(rig)
    usual = CoulombFriction().force / (FORCE / MOTION)
    assert abs(np.log10(held / usual)) <= 0.5 + 1e-9  # forces are scaled by powers of ten
    lower, upper = (getattr(friction.described("force"), end) for end in ("lower", "upper"))
    assert lower == 0.0 and upper / friction.force == pytest.approx(0.02 / 0.7e-3)


def test_only_forces_are_scaled():
    soft, stiff = ({effect.name: effect for effect in everywhere(rig.effects())} for rig in (Diaphragm(), Stack()))
    changed = {
        name
        for name, effect in stiff.items()
        if effect.described(effect.strength) != soft[name].described(effect.strength)
    }
    forces = {name for name, effect in soft.items() if effect.described(effect.strength).unit.startswith("N")}
    assert changed == forces >= {"coulomb_friction", "hysteresis", "end_stop", "periodic_disturbance_at_force"}
    ours, theirs = (effects["hysteresis"] for effects in (stiff, soft))
    assert (ours.distance, ours.beta) == (theirs.distance, theirs.beta)


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
