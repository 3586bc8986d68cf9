"""Materials and dielectrics against closed forms and published numbers: anchors A3, P2 and P3.

A1 and A2, pull-in of a free and of a loaded film, are in test_rigs_closed_forms.py.
"""

import numpy as np
import pytest
from scipy.optimize import root

from deatwin.plant.laws.breakdown import HUANG_2012, KOFOD_2001
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY, electric_energy, maxwell_strain
from deatwin.plant.laws.energies import arruda_boyce, gent, mooney_rivlin, neo_hookean, ogden, yeoh
from deatwin.plant.laws.stress import nominal_stress, shear_modulus
from deatwin.plant.material import MATERIALS

MU, PERMITTIVITY = 25e3, 4.5


ENERGIES = {
    "neo-Hookean": (neo_hookean, (MU,)),
    "Mooney-Rivlin": (mooney_rivlin, (8e3, 2e3)),
    "Yeoh": (yeoh, (10e3, -100.0, 2.0)),
    "Ogden": (ogden, (20e3, 1.3, 2e3, 4.0, -3e3, -2.0)),
    "Gent": (gent, (MU, 107.0)),
    "Arruda-Boyce": (arruda_boyce, (MU, 6.0)),
} | {name: (entry.energy, tuple(p.value for p in entry.elastic)) for name, entry in MATERIALS.items()}


@pytest.mark.parametrize(("energy", "values"), ENERGIES.values(), ids=ENERGIES)
def test_a3_at_small_field_every_film_strains_as_the_linear_one(energy, values):
    # s_z = -e E²/Y, half of it with the other sign along the film, Y = 3 mu. Next order: a few strains, 1e-5 here.
    modulus = 3 * float(shear_modulus(energy, *values))
    field = np.sqrt(1e-5 * modulus / (PERMITTIVITY * VACUUM_PERMITTIVITY))

    def whole(first, second):
        return energy(first, second, *values) + electric_energy(first, second, PERMITTIVITY, field)

    def conditions(stretches):
        return [float(part) / modulus for part in nominal_stress(whole, *stretches)]

    found = root(conditions, (1.0, 1.0), tol=1e-14).x
    across = float(maxwell_strain(PERMITTIVITY, field, modulus))
    assert across == pytest.approx(-1e-5, rel=1e-12, abs=0)
    assert 1 / (found[0] * found[1]) - 1 == pytest.approx(across, rel=1e-4, abs=0)
    assert found - 1 == pytest.approx(np.full(2, -across / 2), rel=1e-4, abs=0)


@pytest.mark.parametrize(("prestretch", "megavolts"), [(3.5, 250), (4.5, 332)])
def test_p2_the_film_of_the_rig_breaks_down_far_above_its_field(prestretch, megavolts):
    # Huang et al. 2012: 51 h^-0.25 l^0.63 in mm and MV/m, for VHB 4905 of 0.5 mm; half a last digit.
    field = HUANG_2012.at(0.5e-3 / prestretch**2, prestretch, prestretch)
    assert field == pytest.approx(51e6 * (0.5 / prestretch**2) ** -0.25 * prestretch**0.63, rel=1e-12)
    assert field / 1e6 == pytest.approx(megavolts, abs=0.5)
    # The largest field of the rig, 3 kV over a film that voltage has widened by a third in area.
    assert 1.33 * 3e3 / (0.5e-3 / prestretch**2) < field


def test_p3_breakdown_grows_tenfold_with_prestrain():
    # Kofod et al. 2001 (abstract): 20 MV/m unstrained, 218 MV/m at 500 % x 500 %.
    assert KOFOD_2001.at(1e-3, 1.0, 1.0) == pytest.approx(20e6, rel=1e-12)
    assert KOFOD_2001.at(1e-3 / 36, 6.0, 6.0) == pytest.approx(218e6, rel=1e-9)


def test_p3_a_film_in_a_stiff_polymer_bears_more_than_a_free_one_by_less_than_three():
    # Two laboratories, two ways to hold the film: 51 against 20 MV/m unstretched is the largest ratio.
    stretches = np.linspace(1.0, 6.0, 11)
    thickness = 1e-3 / stretches**2
    ratio = HUANG_2012.at(thickness, stretches, stretches) / KOFOD_2001.at(thickness, stretches, stretches)
    assert ratio.min() > 1 and ratio.max() < 3
