"""What all rigs of one moved part have in common."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from runs import readings
from slopes import slope_errors

from deatwin.plant import Cone, Coupon, Diaphragm, Disc, Plant, Pressure, catalogue
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.bow_tie import BowTie
from deatwin.plant.rigs.planar import BlockedPlanar, Planar
from deatwin.plant.rigs.roll import Roll
from deatwin.plant.rigs.stack import Stack

RIGS = (
    Planar(),
    Planar(sides="free", side_prestretch=2.0),
    Planar(sides="clamped"),
    Stack(),
    BowTie(),
    BowTie(sides="free", side_prestretch=None, stations=2),
    Roll(),
)
STEP = np.r_[np.zeros(10), np.full(40, 1.5)]
EACH = pytest.mark.parametrize("rig", RIGS, ids=lambda r: f"{r.kind} {getattr(r, 'sides', '')}")


pytestmark = pytest.mark.usefixtures("uncompiled")


@cache
def stepped(rig):
    return readings(Plant(rig=rig), STEP)


KEPT = (
    *(*RIGS, BlockedPlanar(), Disc(), Cone(), Pressure(), Coupon(width=7e-3)),
    *(Diaphragm(resolution="fine", elements=3, ball="bonded"), Diaphragm(prestretch_is_known=False)),
)


@pytest.mark.parametrize("rig", KEPT, ids=lambda r: f"{r.kind} {getattr(r, 'sides', '')}")
def test_a_rig_survives_json(rig):
    assert type(rig).from_dict(json.loads(json.dumps(rig.to_dict()))) == rig
    assert Plant.from_dict(json.loads(json.dumps(Plant(rig=rig).to_dict()))).rig == rig


@pytest.mark.parametrize("rig", [Disc(), Cone(), Pressure()], ids=lambda rig: rig.kind)
def test_the_whole_catalogue_acts_on_films_of_revolution(rig):
    assert all(Plant(rig=rig).accepts(effect) for effect in rig.effects())


@EACH
def test_it_starts_at_rest_moves_the_way_of_its_reading_and_does_not_ring(rig):
    y = stepped(rig)
    np.testing.assert_allclose(y[:10], 0.0, atol=1e-12)
    assert np.all(np.diff(y[9:]) > -1e-12)
    assert y[-1] > 1e-5


@EACH
def test_a_long_hold_comes_to_the_actuation_curve(rig):
    # Exponentials: of the branch, whose time of 0.6 s the film's own stiffness at most triples, and of the damper,
    # whose time stays below 0.3 s; after 40 s both are below e^-20.
    y = readings(Plant(rig=rig), np.full(2000, 1.2))
    curve = actuation_curve(Plant(rig=rig), np.array([1.2]))
    assert y[-1] == pytest.approx(curve.readings[-1], rel=1e-7)


@pytest.mark.parametrize("rig", [Planar(), Stack(), BowTie(), Roll()], ids=lambda rig: rig.kind)
@pytest.mark.parametrize("quarter", range(4))
def test_effects_that_are_off_are_not_there(rig, quarter):
    # In four parts: the more viscous stretches there are, the further from rest begins the search for it.
    plant = Plant(rig=rig)
    accepted = [e for e in catalogue() if plant.accepts(e)]
    assert {"creep", "electrode_rc", "hysteresis", "permittivity_drift"} <= {e.name for e in accepted}
    off = [replace(e, **{e.strength: 0.0}) for e in accepted[quarter::4]]
    np.testing.assert_allclose(readings(plant.with_effects(*off), STEP), stepped(rig), rtol=0, atol=1e-11)


@EACH
def test_sensitivities_are_those_of_differences(rig):
    # Newton's rest of 1e-13 m over steps of 1e-4 of the value, which moves the reading by 1e-8 m or more.
    errors = slope_errors(Plant(rig=rig), STEP, 1e-4)
    assert max(errors.values()) < 1e-4, errors


@EACH
def test_one_factor_on_all_forces_changes_nothing(rig):
    plant = Plant(rig=rig)
    forces = {"shear_modulus", "branch_modulus", "permittivity", "mass", "damping", "load", "side_load", "spring_rate"}
    scaled = {n: 1.7 * p.value for n, p in plant.parameters.items() if n in forces}
    np.testing.assert_allclose(readings(plant.with_values(scaled), STEP), stepped(rig), rtol=0, atol=1e-11)


@EACH
def test_the_sign_of_the_voltage_does_not_count(rig):
    np.testing.assert_allclose(readings(Plant(rig=rig), -STEP), stepped(rig), rtol=0, atol=1e-14)


def test_a_part_without_mass_and_with_little_damping_follows_at_once():
    rig = Planar(prestretch=2.0, mass=0.0, damping=1e-6)
    plant = Plant(rig=rig, values={"branch_modulus": 1.0})
    y = readings(plant, STEP)
    curve = actuation_curve(plant, np.array([1.5]))
    # what the branch of 1 Pa holds back is 1 / 25000 of the motion
    np.testing.assert_allclose(y[11:], curve.readings[-1], rtol=1e-4)


@pytest.mark.parametrize(
    ("middle", "reach", "place"), [(1e-3, 2e-3, -1e-3), (2e-3, 5e-3, -3e-3), (0.0, 3e-3, 3e-3), (3e-3, 2e-3, 1e-3)]
)
def test_a_bistable_spring_takes_the_disc_to_the_place_on_its_own_side(middle, reach, place):
    # A spring of 1 N is far stiffer at its places than a flat film of 50 µm, about 0.1 N/mm: each lies within 0.5 mm.
    plant = Plant(rig=Cone(mass=5e-3, snap_force=1.0, snap_middle=middle, snap_reach=reach))
    rest = rest_state(plant.equations, 0.0, plant.free_values)
    assert rest.x[0] == pytest.approx(place, abs=0.5e-3)
