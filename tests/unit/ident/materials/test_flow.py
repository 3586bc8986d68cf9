"""Stresses of branches and energies, against closed forms, SciPy's integrator and the rig of a strip."""

import numpy as np
import pytest
from made_coupons import BRANCHES, MODULUS, dynamic, gent_equibiaxial, gent_pull, held
from scipy.integrate import solve_ivp

from deatwin.ident.materials.flow import STRETCHES, branch_stress, dynamic_shares, elastic_stress
from deatwin.plant import Branch, Coupon, Experiment, Material, Parameter, Plant, Recording
from deatwin.plant.laws import gent, neo_hookean

MODULI, TIMES = np.array(BRANCHES).T


def path(kind: str, along: np.ndarray) -> np.ndarray:
    return np.vstack([along, STRETCHES[kind](along)])


def test_a_held_stretch_relaxes_as_its_integral_says() -> None:
    times = np.r_[0.0, np.geomspace(0.05, 400.0, 59)]
    found = branch_stress(times, path("uniaxial", np.full(60, 2.0)), TIMES) @ MODULI
    np.testing.assert_allclose(found + gent_pull(np.array(2.0)), held(times, 2.0), rtol=1e-4)


@pytest.mark.parametrize("kind", STRETCHES)
def test_a_pull_and_return_is_that_of_another_integrator(kind: str) -> None:
    times = np.linspace(0.0, 30.0, 121)
    stretches = path(kind, 1 + 1.5 * np.sin(times / 10.0))
    logs = np.log(stretches)

    def rate(at: float, strain: np.ndarray) -> np.ndarray:
        k = min(int(at / 0.25), 119)
        squares = np.exp(2 * strain)
        stresses = squares - 1 / squares.prod()
        return (logs[:, k + 1] - logs[:, k]) / 0.25 - (stresses - stresses[::-1] / 2) / 3 / 5.0

    strain = solve_ivp(rate, (0, 30), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-11, max_step=0.1).y
    squares = np.exp(2 * strain)
    expected = (squares[0] - 1 / squares.prod(axis=0)) / stretches[0]
    np.testing.assert_allclose(branch_stress(times, stretches, np.array([5.0]))[:, 0], expected, atol=2e-5)


def test_it_is_what_the_rig_of_a_strip_simulates() -> None:
    known = {"unit": "Pa", "lower": 1.0, "upper": 1e7}
    branch = Branch(
        name="branch",
        modulus=Parameter(name="branch_modulus", value=80e3, **known),
        time=Parameter(name="branch_time", value=2.0, unit="s", lower=0.1, upper=100.0),
    )
    material = Material(
        name="mine",
        energy=neo_hookean,
        elastic=(Parameter(name="shear_modulus", value=MODULUS, **known),),
        branches=(branch,),
        permittivity=Parameter(name="permittivity", value=3.0, unit="1", lower=1.0, upper=9.0),
    )
    rig = Coupon(material=material, sample_time=0.02)
    times = 0.02 * np.arange(1000)
    stretch = 1 + 0.08 * times
    recording = Recording.from_arrays(stretch, np.zeros(1000), 0.02)
    force = Plant(rig=rig).simulate(Experiment(recordings=(recording,))).require().outputs[0][0]
    stretches = path("uniaxial", stretch)
    elastic, _ = elastic_stress(neo_hookean, stretches, np.array([MODULUS]))
    said = elastic + 80e3 * branch_stress(times, stretches, np.array([2.0]))[:, 0]
    # The staircase of a rig reaches each stretch half a sample early: 0.01 s of a time of 2 s.
    np.testing.assert_allclose(force / (rig.width * rig.thickness), said, rtol=0.01, atol=100.0)


def test_gent_has_its_closed_forms_and_derivatives() -> None:
    values, along = np.array([MODULUS, 60.0]), np.linspace(1.1, 2.5, 8)
    pulled, slopes = elastic_stress(gent, path("uniaxial", along), values)
    np.testing.assert_allclose(pulled, gent_pull(along), rtol=1e-12)
    np.testing.assert_allclose(elastic_stress(gent, path("equibiaxial", along), values)[0], gent_equibiaxial(along))
    nearby = elastic_stress(gent, path("uniaxial", along), values + np.array([0.0, 1e-4]))[0]
    np.testing.assert_allclose((nearby - pulled) / 1e-4, slopes[:, 1], rtol=1e-3)


def test_dynamic_moduli() -> None:
    frequencies = np.geomspace(1e-3, 10.0, 9)
    storage, loss = (3 * share @ MODULI for share in dynamic_shares(frequencies, TIMES))
    np.testing.assert_allclose((storage + 3 * MODULUS, loss), dynamic(frequencies), rtol=1e-12)
