"""The strip in a test machine, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.plant import Coupon, Creep, Experiment, Plant, Recording

RIG = Coupon()
AREA = RIG.width * RIG.thickness
MU, LIMIT = 25e3, 107.0

pytestmark = pytest.mark.usefixtures("uncompiled")


def pull(top=3.0, duration=20.0, sample_time=0.02):
    half = round(duration / sample_time / 2)
    return np.r_[np.linspace(1.0, top, half), np.linspace(top, 1.0, half)]


def gent_force(stretch):
    extension = stretch**2 + 2 / stretch - 3
    return AREA * MU * (stretch - stretch**-2) * LIMIT / (LIMIT - extension)


def test_the_strip_alone_has_the_force_of_the_closed_form(experiment):
    force = Plant(rig=RIG).simulate(experiment(pull())).require().outputs[0][0]
    # The reading of a row belongs to the stretch of the same row.
    np.testing.assert_allclose(force, gent_force(pull()), rtol=1e-12, atol=1e-14)


def test_a_branch_relaxes_as_its_equation_says(experiment):
    plant = Plant(rig=RIG).with_effects(Creep(modulus=40e3, time=5.0))
    force = plant.simulate(experiment(np.full(1000, 2.0))).require().outputs[0][0]

    def rate(_, log_xi):  # tau d(ln xi)/dt = -(1/3) d/d(ln xi) of (le² + 2/le - 3)/2, le = 2/xi
        elastic = 2.0 / np.exp(log_xi)
        return (elastic**2 - 1 / elastic) / 3 / 5.0

    times = 0.02 * np.arange(1, 1001)
    xi = np.exp(solve_ivp(rate, (0, 20), [0.0], t_eval=times, rtol=1e-10, atol=1e-12).y[0])
    branch = AREA * 40e3 * (2.0 / xi**2 - xi / 2.0**2)
    np.testing.assert_allclose(force, gent_force(2.0) + branch, rtol=1e-7)
    assert np.all(np.diff(force) < 0)


def test_each_pull_starts_from_rest():
    plant = Plant(rig=RIG).with_effects(Creep())
    records = [Recording.from_arrays(pull(), np.zeros(1000), 0.02, start=start) for start in (0.0, 500.0)]
    first, second = (plant.simulate(Experiment(recordings=(r,))).outputs[0] for r in records)
    np.testing.assert_allclose(first, second, atol=1e-14)
    assert first[0, 0] == 0.0


def test_area_is_a_scale_of_all_moduli(experiment):
    thick = Plant(rig=Coupon(width=20e-3)).with_effects(Creep())
    stiff = Plant(
        rig=Coupon(), effects=(Creep(),), values={"shear_modulus": 2 * MU, "creep.modulus": 2 * Creep().modulus}
    )
    forces = [plant.simulate(experiment(pull())).outputs[0] for plant in (thick, stiff)]
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-9, atol=1e-12)


def test_a_strip_at_its_limit_fails_with_a_status(experiment):
    # Gent's limit J = 107 is at a stretch of 10.5.
    simulation = Plant(rig=RIG).simulate(experiment(np.linspace(1.0, 12.0, 100)))
    assert not simulation.status.ok
    assert simulation.failed_command == pytest.approx(10.5, abs=0.1)
