"""`Parameter` and `ParameterSet`."""

import numpy as np
import pytest

from deatwin.plant import Parameter, ParameterSet, RigError, Scale

MODULUS = Parameter(name="shear_modulus", value=25e3, unit="Pa", lower=5e3, upper=200e3)
MASS = Parameter(name="mass", value=3e-3, unit="kg", lower=1e-6, upper=1.0, known=True)


def test_a_set_is_an_ordered_mapping():
    parameters = ParameterSet([MODULUS, MASS])
    assert list(parameters) == ["shear_modulus", "mass"]
    assert parameters.free == ("shear_modulus",)
    assert parameters.array().tolist() == [25e3, 3e-3]
    assert parameters.array(["mass"]).tolist() == [3e-3]
    assert "shear_modulus = 25000 Pa" in repr(parameters)


def test_new_values_make_a_new_set():
    before = ParameterSet([MODULUS, MASS])
    after = before.with_values({"mass": 4e-3})
    assert (before["mass"].value, after["mass"].value) == (3e-3, 4e-3)


@pytest.mark.parametrize("scale", list(Scale))
def test_the_slope_of_a_scale_is_its_derivative(scale):
    here, step = scale.to_coordinate(3.0), 1e-6
    inverse = {Scale.LINEAR: lambda c: c, Scale.LOGARITHMIC: np.exp, Scale.RECIPROCAL: lambda c: 1 / c}[scale]
    assert inverse(here) == pytest.approx(3.0)
    assert scale.slope(3.0) == pytest.approx((inverse(here + step) - inverse(here - step)) / (2 * step))


@pytest.mark.parametrize(
    ("scale", "ends"),
    [(Scale.LINEAR, (0.5, 4.0)), (Scale.LOGARITHMIC, (np.log(0.5), np.log(4.0))), (Scale.RECIPROCAL, (0.25, 2.0))],
)
def test_the_ends_of_a_range_are_in_order_in_every_coordinate(scale, ends):
    found = Parameter(name="a", value=1.0, unit="1", lower=0.5, upper=4.0, scale=scale).ends
    assert found == pytest.approx(ends, rel=1e-12)


def test_a_range_that_no_physics_ends_widens_up_to_its_widest():
    usual = Parameter(name="time", value=0.03, unit="s", lower=0.0, upper=0.1, widest=1.0)
    ranges = [ParameterSet([usual]).with_values({"time": value})["time"].upper for value in (0.1, 0.101, 0.4, 0.5, 1.0)]
    assert ranges == pytest.approx([0.1, 0.4, 0.4, 1.0, 1.0])
    with pytest.raises(RigError, match="allowed is 0 to 1 s"):
        ParameterSet([usual]).with_values({"time": 1.1})
    signed = Parameter(name="force", value=-3.0, unit="N", lower=-2.0, upper=2.0, widest=9.0)
    assert (signed.lower, signed.upper) == (-8.0, 2.0)


def test_beyond_an_end_lies_a_wider_range_unless_physics_ends_there():
    ends = {0.0: None, 0.1: 0.101, 0.4: 0.404, 1.0: None}
    for value, beyond in ends.items():
        parameter = Parameter(name="time", value=value, unit="s", lower=0.0, upper=0.1, widest=1.0)
        assert parameter.beyond == (None if beyond is None else pytest.approx(beyond))
    assert MODULUS.beyond is None
