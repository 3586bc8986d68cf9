"""Published sets of materials."""

import pytest

from deatwin.plant import Coupon, Diaphragm, RigError
from deatwin.plant.material import MATERIALS, material

every = pytest.mark.parametrize("name", MATERIALS)


@every
def test_a_material_carries_sources_and_ranges(name):
    entry = MATERIALS[name]
    assert entry.name == name
    assert all(p.source and p.lower < p.value < p.upper for p in entry.parameters)


@every
def test_parameters_are_elastic_then_branches_then_permittivity(name):
    entry = MATERIALS[name]
    names = [p.name for p in entry.parameters]
    of_branches = [f"{b}{end}" for b in ("branch", "branch_2", "branch_3") for end in ("_modulus", "_time")]
    assert names == [*(p.name for p in entry.elastic), *of_branches[: 2 * len(entry.branches)], "permittivity"]
    assert len(set(names)) == len(names)


@every
def test_a_material_is_at_rest_as_stiff_as_published_ones(name):
    # Published moduli at rest: 13.7 to 45 kPa.
    assert 13e3 < MATERIALS[name].shear_modulus < 45e3


def test_the_set_of_wang_has_its_figures():
    entry = material("VHB 4910 Wang 2016")
    assert [p.value for p in entry.parameters] == [15.36e3, 5.99, 26.06e3, 0.6074, 26.53e3, 6.56, 10.83e3, 61.25, 4.8]
    # An Arruda-Boyce solid starts stiffer than its modulus by (1 - 1/(3 n))/(1 - 1/n), n = 5.99².
    assert entry.shear_modulus == pytest.approx(15.36e3 * (1 - 1 / (3 * 5.99**2)) / (1 - 5.99**-2), rel=1e-12)


def test_a_set_identified_in_the_same_films_agrees_with_it():
    # Two laboratories on VHB 4910: 13.7 and 15.7 kPa when relaxed, 121 and 79 kPa at once.
    wang, hossain = material("VHB 4910 Wang 2016"), material("VHB 4910 Hossain 2012")
    assert hossain.shear_modulus == pytest.approx(wang.shear_modulus, rel=0.15)


@every
def test_rigs_take_every_material(name):
    assert {p.name for p in MATERIALS[name].parameters} <= {p.name for p in Diaphragm(material=name).parameters}
    assert {p.name for p in MATERIALS[name].elastic} <= {p.name for p in Coupon(material=name).parameters}


@every
def test_a_film_can_be_prestretched_in_the_whole_range_of_its_limit(name):
    # 4.5 is the larger reading of the thesis' prestretch: a fit that reaches a bound must still have a stress there.
    entry = MATERIALS[name]
    lowest = [p.lower if p.name in ("stretch_limit", "locking_stretch") else p.value for p in entry.elastic]
    assert float(entry.energy(4.5, 4.5, *lowest)) > 0


def test_an_unknown_material_gets_the_near_one():
    with pytest.raises(RigError, match='did you mean "VHB 4905"'):
        material("VHB4905")
