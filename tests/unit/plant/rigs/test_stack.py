"""The stack's own."""

import numpy as np
import pytest

from deatwin.plant import Plant
from deatwin.plant.actuation import CurveEnd, actuation_curve
from deatwin.plant.rigs.stack import Stack


def test_twice_the_layers_shorten_twice_as_far_and_hold_twice_the_charge():
    curves = [actuation_curve(Plant(rig=Stack(layers=n)), np.array([0.0, 1.0])) for n in (50, 100)]
    assert curves[1].readings[1] == pytest.approx(2 * curves[0].readings[1], rel=1e-9)
    ratio = curves[1].signals["capacitance"] / curves[0].signals["capacitance"]
    np.testing.assert_allclose(ratio, 2.0, rtol=1e-9)


def test_a_load_lengthens_it_by_what_a_slender_bar_gives():
    rig = Stack(load=1e-3)
    plant = Plant(rig=rig)
    longer = -actuation_curve(plant, np.array([0.0])).unknowns["position"][0]
    strain = rig.load / (3 * plant.parameters["shear_modulus"].value * rig.area)
    assert longer == pytest.approx(rig.layers * rig.thickness * strain, rel=3 * strain)  # next term: the strain


def test_a_pulled_stack_bears_a_higher_voltage():
    tops = [actuation_curve(Plant(rig=Stack(load=load)), np.linspace(0, 5, 51)) for load in (0.0, 2.0)]
    assert all(curve.end is CurveEnd.PULL_IN for curve in tops)
    assert tops[1].commands[-1] > tops[0].commands[-1]
