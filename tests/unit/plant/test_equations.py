"""The builder: what it refuses, and systems without this or that."""

import pytest

from deatwin.plant import Coupon, Diaphragm, Hysteresis, ParameterSet, Plant, RigError
from deatwin.plant.builder import Builder


def builder(*parameters):
    return Builder(ParameterSet(parameters), [])


def test_an_effect_needs_a_rig_with_its_signal():
    with pytest.raises(RigError, match="effect hysteresis acts on ball signal 'force'"):
        _ = Plant(rig=Coupon()).with_effects(Hysteresis()).equations


def test_an_unknown_signal_gets_the_near_one():
    build = builder()
    build.watch("velocity", build.command)
    with pytest.raises(RigError, match='did you mean "velocity"'):
        build.signal("velocty")


def test_a_coordinate_without_a_balance_is_refused():
    build = builder()
    build.coordinate("stretch", scale=1.0)
    with pytest.raises(RigError, match="1 algebraic coordinates need as many balances, 0"):
        build.finish(build.command)


def test_a_parameter_that_the_plant_lacks_is_refused():
    with pytest.raises(RigError, match="there is no parameter 'gain'"):
        builder().parameter("gain")


def test_sizes_of_a_rig_do_not_change_its_code():
    sizes = [Plant(rig=Diaphragm()), Plant(rig=Diaphragm(frame_radius=50e-3, thickness=1e-3))]
    codes = [plant.equations.dynamics.serialize() for plant in sizes]
    assert codes[0] == codes[1]
