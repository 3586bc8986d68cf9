"""The field at breakdown."""

import numpy as np
import pytest

from deatwin.plant.laws.breakdown import HUANG_2012, BreakdownLaw

LAW = BreakdownLaw(field=50e6, thickness=1e-3, thickness_power=-0.5, stretch_power=1.0, source="a test")


def test_a_law_has_its_field_at_its_thickness():
    assert LAW.at(1e-3, 1.0, 1.0) == 50e6


def test_thin_and_stretched_films_bear_more_by_the_powers():
    assert LAW.at(0.25e-3, 1.0, 1.0) == pytest.approx(100e6, rel=1e-12)
    assert LAW.at(1e-3, 3.0, 3.0) == pytest.approx(150e6, rel=1e-12)


def test_unequal_stretches_count_as_the_equal_one_of_the_same_area():
    assert LAW.at(1e-3, 2.0, 4.5) == pytest.approx(LAW.at(1e-3, 3.0, 3.0), rel=1e-12)


def test_a_law_takes_whole_films():
    stretches = np.array([3.0, 3.5, 4.0])
    fields = HUANG_2012.at(0.5e-3 / stretches**2, stretches, stretches)
    assert fields.shape == (3,) and np.all(np.diff(fields) > 0)
