"""What every energy of an isotropic, incompressible film has, and what every dielectric has."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deatwin.plant.laws.energies import arruda_boyce, gent, mooney_rivlin, neo_hookean, ogden, yeoh
from deatwin.plant.laws.stress import true_stress

moduli = st.floats(1e3, 1e5)
ENERGIES = {
    "neo-Hookean": (neo_hookean, st.tuples(moduli)),
    "Mooney-Rivlin": (mooney_rivlin, st.tuples(moduli, moduli)),
    "Yeoh": (yeoh, st.tuples(moduli, st.floats(0, 1e3), st.floats(0, 10))),
    "Ogden": (ogden, st.tuples(moduli, st.floats(1.0, 4.0), st.floats(-1e5, -1e3), st.floats(-4.0, -1.0))),
    "Gent": (gent, st.tuples(moduli, st.floats(60.0, 1e3))),
    "Arruda-Boyce": (arruda_boyce, st.tuples(moduli, st.floats(5.0, 50.0))),
}
every = pytest.mark.parametrize(("energy", "parameters"), ENERGIES.values(), ids=ENERGIES)
stretches = st.floats(0.6, 3.5)
quick = settings(deadline=None, max_examples=40)
ROUNDING = 1e-12
"""Of the parameters: powers that cancel in the unstretched film, and Gent's modulus times its limit of up to 1000, are
rounded to 2e-16 each, some at a stretch that was rounded before."""


def floats(parts):
    return np.array([float(part) for part in parts])


@every
@quick
@given(data=st.data(), first=stretches, second=stretches)
def test_no_direction_is_special(energy, parameters, data, first, second):
    # Isotropic and incompressible: any two of the three stretches give the same energy.
    values = data.draw(parameters)
    here, third = float(energy(first, second, *values)), 1 / (first * second)
    rounding = ROUNDING * sum(abs(v) for v in values)
    assert here >= -rounding
    for pair in ((second, first), (first, third), (third, second)):
        assert float(energy(*pair, *values)) == pytest.approx(here, rel=1e-8, abs=rounding)


@every
@quick
@given(data=st.data(), first=stretches, second=stretches)
def test_a_larger_stretch_has_the_larger_true_stress(energy, parameters, data, first, second):
    # Baker and Ericksen's inequality, which these parameters keep.
    values = data.draw(parameters)
    along, across = floats(true_stress(energy, first, second, *values))
    size = 1e-9 * (abs(along) + abs(across) + max(values))
    assert (along - across) * (first - second) >= -size
    assert along * (first - 1 / (first * second)) >= -size
