"""The strip in a test machine, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.plant import Coupon, Creep, Experiment, Plant, Recording
from deatwin.plant.effects.creep import CreepSpectrum

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


@pytest.mark.parametrize(
    ("effect", "times"),
    [
        (Creep(modulus=40e3, time=5.0), (5.0,)),
        (CreepSpectrum(modulus=40e3, time=5.0, decades=2.0), (0.5, 5.0, 50.0)),
    ],
)
def test_branches_relax_as_their_equation_says(experiment, effect, times):
    force = Plant(rig=RIG).with_effects(effect).simulate(experiment(np.full(1000, 2.0))).require().outputs[0][0]

    def branch(time):  # tau d(ln xi)/dt = -(1/3) d/d(ln xi) of (le² + 2/le - 3)/2, le = 2/xi
        def rate(_, log_xi):
            elastic = 2.0 / np.exp(log_xi)
            return (elastic**2 - 1 / elastic) / 3 / time

        clock = 0.02 * np.arange(1, 1001)
        xi = np.exp(solve_ivp(rate, (0, 20), [0.0], method="Radau", t_eval=clock, rtol=1e-10, atol=1e-12).y[0])
        return AREA * 40e3 / len(times) * (2.0 / xi**2 - xi / 2.0**2)

    np.testing.assert_allclose(force, gent_force(2.0) + sum(map(branch, times)), rtol=1e-7)
    assert np.all(np.diff(force) < 0)


def test_a_saved_plant_keeps_the_spectrum_of_its_creep():
    plant = Plant(rig=RIG).with_effects(CreepSpectrum(modulus=30e3, time=8.0, decades=1.5))
    again = Plant.from_dict(plant.to_dict())
    assert isinstance(again.effects[0], CreepSpectrum)
    assert again.to_dict() == plant.to_dict()


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
