"""The field at breakdown."""

import pytest

from deatwin.plant.laws.breakdown import BreakdownLaw

LAW = BreakdownLaw(field=50e6, thickness=1e-3, thickness_power=-0.5, stretch_power=1.0, source="a test")


def test_unequal_stretches_count_as_the_equal_one_of_the_same_area():
    assert LAW.at(1e-3, 2.0, 4.5) == pytest.approx(LAW.at(1e-3, 3.0, 3.0), rel=1e-12)
