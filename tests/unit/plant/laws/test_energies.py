"""Energies of the film."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from deatwin.plant.errors import ModelError
from deatwin.plant.laws.energies import (
    arruda_boyce,
    gent,
    maxwell_branch,
    mooney_rivlin,
    neo_hookean,
    ogden,
    yeoh,
)
from deatwin.plant.laws.stress import shear_modulus

MU = 25e3
CASES = {
    "neo-Hookean": (neo_hookean, (MU,), MU),
    "Mooney-Rivlin": (mooney_rivlin, (8e3, 2e3), 20e3),
    "Yeoh": (yeoh, (10e3, -100.0, 2.0), 20e3),
    "Ogden": (ogden, (20e3, 1.3, 2e3, 4.0, -3e3, -2.0), (20e3 * 1.3 + 2e3 * 4.0 + 3e3 * 2.0) / 2),
    "Gent": (gent, (MU, 107.0), MU),
    "Arruda-Boyce": (arruda_boyce, (MU, 6.0), MU * (1 - 1 / 108) / (1 - 1 / 36)),
    "Maxwell branch": (maxwell_branch, (), 1.0),
}
every = pytest.mark.parametrize(("energy", "values", "modulus"), CASES.values(), ids=CASES)


def slope(energy, stretch, step=1e-5):
    return (energy(stretch + step) - energy(stretch - step)) / (2 * step)


@every
def test_an_energy_is_zero_and_flat_where_nothing_is_stretched(energy, values, modulus):
    # Rounding in the difference of two energies of size modulus * step**2.
    assert float(energy(1.0, 1.0, *values)) == pytest.approx(0.0, abs=1e-12 * modulus)
    assert slope(lambda s: float(energy(s, 1.0, *values)), 1.0) == pytest.approx(0.0, abs=1e-8 * modulus)


@every
def test_the_shear_modulus_at_small_strain_is_the_stated_one(energy, values, modulus):
    assert float(shear_modulus(energy, *values)) == pytest.approx(modulus, rel=1e-12)


def inverse_langevin(extension):
    return brentq(lambda x: 1 / np.tanh(x) - 1 / x - extension, 1e-3, 1e6, xtol=1e-14, rtol=1e-14)


@pytest.mark.parametrize("extension", [0.2, 0.4, 0.6, 0.7, 0.8, 0.81, 0.82, 0.9, 0.97, 0.999])
def test_arruda_boyce_against_the_exact_inverse_langevin_function(extension):
    # dW/d(chain stretch) = mu lambda_L beta(z). Cohen's form is 0 to 4.94 % high (Jedynak, Rheol. Acta 54 (2015) 29).
    locking = 6.0
    chain = extension * locking

    def energy(value):
        stretch = brentq(lambda s: s**2 + 2 / s - 3 * value**2, 1.0, 20.0, xtol=1e-14)
        return float(arruda_boyce(stretch, stretch**-0.5, MU, locking))

    force = slope(energy, chain, step=1e-6 * locking) / (MU * locking)
    assert 0 <= force / inverse_langevin(extension) - 1 + 1e-6 < 0.0495


@pytest.mark.parametrize(("energy", "values"), [(gent, (MU, 30.0)), (arruda_boyce, (MU, 3.0))])
def test_beyond_the_limit_neither_energy_nor_stress_has_a_value(energy, values):
    stretch = ca.SX.sym("stretch")
    both = energy(stretch, stretch, *values)
    function = ca.Function("f", [stretch], [both, ca.gradient(both, stretch)])
    assert all(np.isfinite(float(part)) for part in function(3.0))
    assert all(np.isnan(float(part)) for part in function(4.5))


@pytest.mark.parametrize("terms", [(), (20e3,), (20e3, 1.3, 2e3)])
def test_a_modulus_of_ogden_needs_an_exponent(terms):
    with pytest.raises(ModelError, match=f"{len(terms)} terms of an Ogden energy: give pairs"):
        ogden(1.1, 1.2, *terms)
