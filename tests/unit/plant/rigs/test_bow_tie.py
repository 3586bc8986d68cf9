"""The bow-tie's own."""

import numpy as np
import pytest

from deatwin.plant import Plant
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.rigs.bow_tie import BowTie


def test_the_waist_is_stretched_most_and_has_the_highest_field():
    rig = BowTie()
    curve = actuation_curve(Plant(rig=rig), np.array([1.0]))
    along = [curve.unknowns[f"stretch_{k}"][0] for k in range(rig.stations - 1)]
    assert np.all(np.diff(along) < 0)
    assert curve.signals["field"][0] == pytest.approx(800.0 * along[0] * 3.0 / rig.thickness, rel=1e-12)


def test_free_sides_give_far_less_than_held_ones():
    held, free = (
        actuation_curve(Plant(rig=rig), np.array([0.0, 2.0])).readings[-1]
        for rig in (BowTie(), BowTie(sides="free", side_prestretch=None))
    )
    assert held > 10 * free


def test_a_free_strip_of_the_mean_width_has_the_prestretch():
    rig = BowTie(sides="free", side_prestretch=None, waist_width=40e-3, bar_width=40e-3)
    curve = actuation_curve(Plant(rig=rig), np.array([0.0]))
    assert curve.unknowns["position"][0] == pytest.approx(1.5 * rig.length, rel=1e-9)
