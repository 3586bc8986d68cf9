"""The roll's own."""

import numpy as np
import pytest

from deatwin.plant import Plant
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.rigs.planar import Planar
from deatwin.plant.rigs.roll import Roll


def test_the_spring_holds_the_prestretch_and_is_compressed():
    rig = Roll()
    plant = Plant(rig=rig)
    curve = actuation_curve(plant, np.array([0.0]))
    assert curve.unknowns["position"][0] == pytest.approx(rig.prestretch * rig.length, rel=1e-10)
    assert plant.parameters["spring_length"].value > rig.prestretch * rig.length


def test_a_soft_long_spring_is_a_dead_load():
    commands = np.linspace(0.0, 1.0, 3)
    size = {"length": 15e-3, "width": 0.5, "prestretch": 3.0}
    roll = Roll(hoop_prestretch=4.5, spring_rate=1e-4, **size)
    strip = Planar(side_prestretch=4.5, sides="clamped", **size)
    readings = [actuation_curve(Plant(rig=rig), commands).readings for rig in (roll, strip)]
    # the spring gives way by its rate over the film's, about 1e-4 over 100 N/m
    np.testing.assert_allclose(readings[0], readings[1], rtol=1e-6, atol=1e-14)
