"""Energies of the film."""

import casadi as ca
import numpy as np
import pytest

from deatwin.plant import RigError
from deatwin.plant.material import MATERIALS, gent, material, maxwell_branch, neo_hookean

MU = 25e3


def slope(energy, stretch, step=1e-5):
    return (energy(stretch + step) - energy(stretch - step)) / (2 * step)


@pytest.mark.parametrize(
    "energy", [lambda a, b: neo_hookean(a, b, MU), lambda a, b: gent(a, b, MU, 107.0), maxwell_branch]
)
def test_an_energy_is_zero_and_flat_where_nothing_is_stretched_and_positive_elsewhere(energy):
    assert float(energy(1.0, 1.0)) == pytest.approx(0.0, abs=1e-12)
    assert slope(lambda s: float(energy(s, 1.0)), 1.0) == pytest.approx(0.0, abs=1e-4)
    rng = np.random.default_rng(0)
    for first, second in rng.uniform(0.5, 4.0, (20, 2)):
        assert float(energy(first, second)) > 0
        assert float(energy(first, second)) == pytest.approx(float(energy(second, first)))


def test_gent_without_a_limit_is_neo_hookean():
    # -J/2 ln(1 - x/J) = x/2 (1 + x/(2J) + ...)
    extension = 2 * 2.0**2 + 2.0**-4 - 3
    assert float(gent(2.0, 2.0, MU, 1e6)) == pytest.approx(
        float(neo_hookean(2.0, 2.0, MU)) * (1 + extension / 2e6), rel=1e-9
    )


def test_a_small_uniaxial_pull_finds_three_times_the_shear_modulus():
    # Y = 3 mu of an incompressible solid; the second difference is exact to its step squared.
    step = 1e-4
    values = [float(gent(s, s**-0.5, MU, 107.0)) for s in (1 - step, 1.0, 1 + step)]
    assert np.diff(values, 2)[0] / step**2 == pytest.approx(3 * MU, rel=1e-4)


def test_energies_take_symbols():
    stretch = ca.SX.sym("stretch")
    stress = ca.Function("s", [stretch], [ca.gradient(gent(stretch, stretch, MU, 107.0), stretch)])
    assert float(stress(3.5)) == pytest.approx(slope(lambda s: float(gent(s, s, MU, 107.0)), 3.5), rel=1e-8)


def test_materials_carry_sources():
    for entry in MATERIALS.values():
        assert all(p.source and p.lower < p.value < p.upper for p in entry.parameters)


def test_an_unknown_material_gets_the_near_one():
    with pytest.raises(RigError, match='did you mean "VHB 4905"'):
        material("VHB4905")
