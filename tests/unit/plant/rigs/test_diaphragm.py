"""The diaphragm's two resolutions: what may be asked of it, and effects on both films."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.plant import Creep, Diaphragm, Plant, catalogue
from deatwin.plant.rest import rest_state

COARSEST = Diaphragm(resolution="fine", elements=1)


def rest(plant, command=2.4):
    state = rest_state(plant.equations, command, plant.free_values)
    assert state.found
    return dict(zip(plant.equations.states + plant.equations.coordinates, [*state.x, *state.z], strict=True))


def test_finer_ends_nowhere():
    assert Diaphragm().finer() == Diaphragm(resolution="fine")
    assert COARSEST.finer().elements == 2


@pytest.mark.parametrize("ball", ["sliding", "bonded"])
def test_both_films_have_the_same_parameters_and_main_coordinates(ball):
    rig = Diaphragm(ball=ball)
    coarse, fine = Plant(rig=rig), Plant(rig=rig.finer())
    assert list(coarse.parameters) == list(fine.parameters)
    shared = {"deflection", "velocity", "electrode_stretch", "outer_drop"}
    assert shared <= set(rest(coarse)) & set(rest(fine))
    # They are the same quantities: within the 1.5 % by which the reduced film may err.
    for name in shared - {"velocity"}:
        assert rest(coarse)[name] == pytest.approx(rest(fine)[name], rel=0.015)


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: e.name)
def test_every_effect_acts_on_the_fine_film_too(effect):
    base, with_effect = Plant(rig=COARSEST), Plant(rig=COARSEST).with_effects(effect)
    off = Plant(rig=COARSEST).with_effects(replace(effect, **{effect.strength: 0.0}))
    assert np.isfinite(list(rest(with_effect).values())).all()
    # Both searches end below 1e-11 of each unknown's scale.
    assert rest(off)["deflection"] == pytest.approx(rest(base)["deflection"], abs=1e-12)


def test_a_branch_of_the_fine_film_has_two_states_at_each_point():
    plant = Plant(rig=COARSEST).with_effects(Creep())
    points = 2 * (1 + 1) + 1  # two in each element of electrode and annulus, and the disc under the ball
    assert sum(name.startswith("creep_stretch") for name in plant.equations.states) == 2 * points
    # Relaxed everywhere at rest: a branch holds nothing.
    stiffer = plant.with_values({"creep.modulus": 1e5})
    assert rest(stiffer)["deflection"] == pytest.approx(rest(Plant(rig=COARSEST))["deflection"], abs=1e-12)


@pytest.mark.parametrize("ball", ["bonded", "sliding"])
@pytest.mark.parametrize("resolution", ["reduced", "fine"])
def test_a_film_that_was_not_stretched_hangs_in_its_ring(ball, resolution):
    plant = Plant(rig=Diaphragm(prestretch=1.0, ball=ball, resolution=resolution))
    rest = rest_state(plant.equations, 0.0, plant.free_values)
    assert rest.found
    # A cone between ball and ring, L = 37 mm, with the elastic modulus of its film and branch, would sag by
    # L (2 m g ln(B/r)/(2 pi E H L))^(1/3) = 8 mm; the shapes differ by less than half.
    assert 4e-3 < rest.x[0] < 12e-3
