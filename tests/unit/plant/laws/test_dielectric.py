"""Electrostatics of the film."""

import numpy as np
import pytest

from deatwin.plant.laws.dielectric import (
    VACUUM_PERMITTIVITY,
    capacitance,
    conduction_density,
    effective_permittivity,
    electric_energy,
    electrostriction_factors,
    electrostrictive_strain,
    maxwell_strain,
    maxwell_stress,
)
from deatwin.plant.laws.permittivity import stretched
from deatwin.plant.laws.stress import true_stress

MU, PERMITTIVITY = 25e3, 4.5
MODULUS = 3 * MU


def test_in_plane_stress_is_minus_the_maxwell_stress_along_both():
    nominal, first, second = 20e6, 1.3, 1.7
    expected = -float(maxwell_stress(PERMITTIVITY, nominal * first * second))
    assert expected == pytest.approx(-4.5 * 8.8541878188e-12 * (20e6 * 1.3 * 1.7) ** 2)
    found = true_stress(electric_energy, first, second, PERMITTIVITY, nominal)
    assert [float(part) for part in found] == pytest.approx([expected, expected], rel=1e-12)


def hookes_strain(across, along, ratio):
    return (across - 2 * ratio * along) / MODULUS


@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.35, 0.5])
def test_the_strain_is_that_of_attraction_across_and_repulsion_along(ratio):
    # Maxwell's tensor e (E E - E²/2): half of e E² pulls the electrodes together, half spreads each.
    half = float(maxwell_stress(PERMITTIVITY, 5e6)) / 2
    assert maxwell_strain(PERMITTIVITY, 5e6, MODULUS, ratio) == pytest.approx(
        hookes_strain(-half, half, ratio), rel=1e-12, abs=0
    )


def test_the_thesis_factor_of_one_half_is_that_of_attraction_alone():
    stress = float(maxwell_stress(PERMITTIVITY, 5e6))
    thesis = -0.5 * stress / MODULUS  # eq. 2.2 with the compliance 1/Y
    assert maxwell_strain(PERMITTIVITY, 5e6, MODULUS, 0.0) == pytest.approx(thesis, rel=1e-12, abs=0)
    assert maxwell_strain(PERMITTIVITY, 5e6, MODULUS) == pytest.approx(2 * thesis, rel=1e-12, abs=0)


def test_electrostriction_at_small_strain_is_a_scale_of_the_permittivity():
    coefficient = -2.0e12
    for field in (1e6, 3e6):
        both = float(maxwell_strain(PERMITTIVITY, field, MODULUS)) + float(
            electrostrictive_strain(PERMITTIVITY, field, coefficient)
        )
        scaled = effective_permittivity(PERMITTIVITY, coefficient, MODULUS)
        assert float(maxwell_strain(scaled, field, MODULUS)) == pytest.approx(both, rel=1e-12, abs=0)
    assert scaled > PERMITTIVITY
    assert effective_permittivity(PERMITTIVITY, 0.0, MODULUS) == PERMITTIVITY


@pytest.mark.parametrize(("first", "second"), [(1.0, 1.0), (3.5, 3.5), (1.2, 4.0)])
def test_the_factors_are_the_derivative_of_the_co_energy(first, second):
    slope, nominal = -0.053, 15e6

    def co_energy(a, b, field):
        return electric_energy(a, b, stretched(a, b, 4.68, slope), field)

    field = nominal * first * second
    here = stretched(first, second, 4.68, slope)
    ideal = float(maxwell_stress(here, field))
    found = true_stress(co_energy, first, second, nominal)
    factors = electrostriction_factors(stretched, first, second, 4.68, slope)
    for stress, factor, stretch in zip(found, factors, (first, second), strict=True):
        assert float(stress) == pytest.approx(-ideal * float(factor), rel=1e-12)
        closed = 1 + slope * stretch / (1 + slope * (first + second - 2)) / 2
        assert float(factor) == pytest.approx(closed, rel=1e-12)


def test_the_two_forms_of_electrostriction_agree_at_small_strain():
    # s_z = -e E² (1 + k/2)/Y against -e E²/Y + Q e0² (er - 1)² E², with k = d ln e / d ln l at rest.
    slope = -0.053
    coefficient = -slope * 4.68 / (2 * MODULUS * VACUUM_PERMITTIVITY * 3.68**2)
    factor = float(electrostriction_factors(stretched, 1.0, 1.0, 4.68, slope)[0])
    assert effective_permittivity(4.68, coefficient, MODULUS) == pytest.approx(4.68 * factor, rel=1e-12)


def test_the_capacitance_of_a_flat_film():
    # One plate capacitor of area A l² and distance H / l².
    expected = 4.5 * 8.8541878188e-12 * (1e-3 * 9.0) / (0.5e-3 / 9.0)
    points = [(3.0, 3.0)] * 4
    assert capacitance([4.5] * 4, points, [0.25e-3] * 4, 0.5e-3) == pytest.approx(expected, rel=1e-12, abs=0)


def test_the_capacitance_holds_the_co_energy():
    rng = np.random.default_rng(3)
    stretches, areas, permittivities = rng.uniform(1, 4, (6, 2)), rng.uniform(1e-5, 1e-4, 6), rng.uniform(3, 5, 6)
    voltage, thickness = 2.4e3, 0.5e-3
    energy = sum(
        a * thickness * electric_energy(*pair, e, voltage / thickness)
        for pair, a, e in zip(stretches, areas, permittivities, strict=True)
    )
    assert energy == pytest.approx(
        -capacitance(permittivities, stretches, areas, thickness) * voltage**2 / 2, rel=1e-12
    )


def test_conduction_is_odd_and_ohmic_at_low_field():
    assert float(conduction_density(-60e6)) == -float(conduction_density(60e6))
    assert float(conduction_density(1e3, 3e-14, 40e6)) == pytest.approx(3e-11, rel=1e-4, abs=0)
    # 60 MV/m: sigma = 3.23e-14 e^1.5 S/m
    assert float(conduction_density(60e6)) == pytest.approx(3.23e-14 * np.exp(1.5) * 60e6, rel=1e-12, abs=0)
