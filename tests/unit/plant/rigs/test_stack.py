"""The stack's own."""

import numpy as np
import pytest

from deatwin.plant import Plant
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.rigs.stack import Stack


def test_a_load_lengthens_it_by_what_a_slender_bar_gives():
    rig = Stack(load=1e-3)
    plant = Plant(rig=rig)
    longer = -actuation_curve(plant, np.array([0.0])).unknowns["position"][0]
    strain = rig.load / (3 * plant.parameters["shear_modulus"].value * rig.area)
    assert longer == pytest.approx(rig.layers * rig.thickness * strain, rel=3 * strain)  # next term: the strain
