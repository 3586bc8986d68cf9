"""Stresses and tangents against closed forms and differences."""

import casadi as ca
import numpy as np
import pytest

from deatwin.plant.laws.energies import arruda_boyce, gent, mooney_rivlin, neo_hookean, ogden, yeoh
from deatwin.plant.laws.stress import nominal_stress, tangent, true_stress

MU, LIMIT, LOCKING = 25e3, 107.0, 6.0


def invariants(first, second):
    return first**2 + second**2 + (first * second) ** -2, first**-2 + second**-2 + (first * second) ** 2


def cohen(first, second):
    chain = np.sqrt(invariants(first, second)[0] / 3)
    z = chain / LOCKING
    return MU / 6 * LOCKING / chain * z * (3 - z**2) / (1 - z**2)


def extension(first, second):
    return invariants(first, second)[0] - 3


# Each energy with its parameters and, from text books, dW/dI1 and dW/dI2.
OF_INVARIANTS = {
    "neo-Hookean": (neo_hookean, (MU,), lambda a, b: MU / 2, 0.0),
    "Mooney-Rivlin": (mooney_rivlin, (8e3, 2e3), lambda a, b: 8e3, 2e3),
    "Yeoh": (yeoh, (10e3, -100.0, 2.0), lambda a, b: 10e3 - 200.0 * extension(a, b) + 6.0 * extension(a, b) ** 2, 0.0),
    "Gent": (gent, (MU, LIMIT), lambda a, b: MU / 2 * LIMIT / (LIMIT - extension(a, b)), 0.0),
    "Arruda-Boyce": (arruda_boyce, (MU, LOCKING), cohen, 0.0),
}
TERMS = (20e3, 1.3, 2e3, 4.0, -3e3, -2.0)
STRETCHES = [0.6, 1.1, 1.8, 3.5]


def as_floats(pair):
    return [float(part) for part in pair]


@pytest.mark.parametrize("stretch", STRETCHES)
@pytest.mark.parametrize(("energy", "values", "first", "second"), OF_INVARIANTS.values(), ids=OF_INVARIANTS)
def test_energies_of_the_invariants_follow_their_closed_forms(energy, values, first, second, stretch):
    # Rivlin: s1 - s3 = 2 (l1² - l3²)(dW/dI1 + l2² dW/dI2), s3 = 0; sizes below are exact but for rounding.
    small = 1e-11 * MU
    uniaxial = stretch, stretch**-0.5
    along, across = as_floats(true_stress(energy, *uniaxial, *values))
    expected = 2 * (stretch**2 - 1 / stretch) * (first(*uniaxial) + second / stretch)
    assert along == pytest.approx(expected, rel=1e-11)
    assert across == pytest.approx(0.0, abs=10 * small + 1e-11 * abs(along))
    equal = stretch, stretch
    expected = 2 * (stretch**2 - stretch**-4) * (first(*equal) + second * stretch**2)
    assert as_floats(true_stress(energy, *equal, *values)) == pytest.approx([expected, expected], rel=1e-11)
    shear = stretch, 1.0
    along, across = as_floats(true_stress(energy, *shear, *values))
    assert along == pytest.approx(2 * (stretch**2 - stretch**-2) * (first(*shear) + second), rel=1e-11)
    assert across == pytest.approx(2 * (1 - stretch**-2) * (first(*shear) + second * stretch**2), rel=1e-11)


@pytest.mark.parametrize("stretch", STRETCHES)
def test_ogden_follows_its_closed_forms(stretch):
    def expected(power):
        return sum(m * (stretch**a - stretch ** (power * a)) for m, a in zip(TERMS[::2], TERMS[1::2], strict=True))

    along, across = as_floats(true_stress(ogden, stretch, stretch**-0.5, *TERMS))
    assert along == pytest.approx(expected(-0.5), rel=1e-11)
    assert across == pytest.approx(0.0, abs=1e-6)
    assert as_floats(true_stress(ogden, stretch, stretch, *TERMS)) == pytest.approx([expected(-2.0)] * 2, rel=1e-11)
    assert float(true_stress(ogden, stretch, 1.0, *TERMS)[0]) == pytest.approx(expected(-1.0), rel=1e-11)


EVERY = {name: case[:2] for name, case in OF_INVARIANTS.items()} | {"Ogden": (ogden, TERMS)}


@pytest.mark.parametrize(("energy", "values"), EVERY.values(), ids=EVERY)
def test_nominal_stress_and_tangent_are_the_derivatives(energy, values):
    # Central differences: truncation step² and rounding 1e-16 / step, both near 1e-10 of the curvature.
    step = 1e-5
    for first, second in np.random.default_rng(1).uniform(0.7, 3.5, (10, 2)):

        def stress(a, b):
            return np.array(as_floats(nominal_stress(energy, a, b, *values)))

        work = [
            float(energy(first + step, second, *values) - energy(first - step, second, *values)),
            float(energy(first, second + step, *values) - energy(first, second - step, *values)),
        ]
        scale = np.abs(stress(first, second)).max() + MU
        np.testing.assert_allclose(stress(first, second), np.array(work) / (2 * step), rtol=0, atol=1e-7 * scale)
        by_first = (stress(first + step, second) - stress(first - step, second)) / (2 * step)
        by_second = (stress(first, second + step) - stress(first, second - step)) / (2 * step)
        t11, t12, t22 = as_floats(tangent(energy, first, second, *values))
        scale = max(abs(t11), abs(t22))
        np.testing.assert_allclose([t11, t12], by_first, rtol=0, atol=1e-7 * scale)
        np.testing.assert_allclose([t12, t22], by_second, rtol=0, atol=1e-7 * scale)


def test_symbols_go_in_and_come_out():
    for kind in (ca.SX, ca.MX):
        stretch, modulus = kind.sym("stretch"), kind.sym("modulus")
        first, _ = nominal_stress(neo_hookean, stretch, stretch, modulus)
        function = ca.Function("f", [stretch, modulus], [first, ca.gradient(first, stretch)])
        stress, stiffness = function(2.0, MU)
        assert float(stress) == pytest.approx(MU * (2 - 2.0**-5))
        # Both stretches move: d/dl of mu (l - l^-5).
        assert float(stiffness) == pytest.approx(MU * (1 + 5 * 2.0**-6))
