"""The plant's own integrator against SUNDIALS (IDAS, relative tolerance 1e-9), on records of 20 s."""

import numpy as np
import pytest
from sundials import reference_outputs

from deatwin.plant import (
    Coupon,
    Creep,
    Delay,
    Diaphragm,
    ElectrodeRC,
    Experiment,
    Hysteresis,
    PermittivityDrift,
    Plant,
    Recording,
    SimulationError,
)
from deatwin.plant.excitation import band_limited_noise, random_holds

BASE = Plant(rig=Diaphragm())
SMOOTH = BASE.with_effects(Creep(), ElectrodeRC(), PermittivityDrift())


def record(commands, start=5.0):
    return Experiment(recordings=(Recording.from_arrays(commands, np.zeros(len(commands)), 0.02, start=start),))


RNG = np.random.default_rng(1)
NOISE = record(band_limited_noise(RNG, 20.0, 0.02))
HOLDS = record(random_holds(RNG, 20.0, 0.02, 1.1, 3.75))


def largest_difference(plant, experiment):
    own = plant.simulate(experiment).require().outputs
    return max(np.abs(a - b).max() for a, b in zip(own, reference_outputs(plant, experiment), strict=True))


@pytest.mark.parametrize("experiment", [NOISE, HOLDS], ids=["noise", "holds"])
@pytest.mark.parametrize("plant", [BASE, SMOOTH], ids=["base", "smooth effects"])
def test_every_reading_agrees_to_a_twentieth_of_a_micrometre(plant, experiment):
    assert largest_difference(plant, experiment) < 0.05e-6


def test_a_dead_time_agrees_to_a_hundredth_of_a_micrometre():
    """Both divide a sample where the command jumps, which a step follows to 0.003 µm (`STAGES`)."""
    plant = SMOOTH.with_effects(Delay(time=0.033))
    assert largest_difference(plant, record(random_holds(np.random.default_rng(2), 6.0, 0.02, 1.1, 3.75))) < 0.01e-6


def test_hysteresis_agrees_to_a_tenth_of_the_sensors_noise():
    # At each turning point the force has a kink, which no order resolves: 20 ms steps smear it.
    plant = BASE.with_effects(Hysteresis())
    experiment = record(band_limited_noise(np.random.default_rng(2), 20.0, 0.02))
    own, reference = plant.simulate(experiment).outputs[0], reference_outputs(plant, experiment)[0]
    assert np.sqrt(np.mean((own - reference) ** 2)) < 0.1 * plant.rig.noise


def test_states_without_mass_are_algebraic_there_too():
    experiment = record(band_limited_noise(np.random.default_rng(2), 4.0, 0.02))
    # Two adaptive runs, each to 1e-9 of the typical size a step: some 1e-12 m, gathered over a ring-down.
    off = reference_outputs(BASE.with_effects(ElectrodeRC(time=0.0)), experiment)[0]
    np.testing.assert_allclose(off, reference_outputs(BASE, experiment)[0], rtol=0, atol=1e-10)


def test_it_says_where_it_stops():
    soft = Plant(rig=Diaphragm(), values={"shear_modulus": 8e3, "stretch_limit": 1e4})
    with pytest.raises(SimulationError, match=r"stopped at \d+\.\d\d s and a command of \d\.\d+ V"):
        reference_outputs(soft, record(np.linspace(0.0, 3.75, 500)))


def test_a_pulled_strip_agrees_to_ten_nanonewton():
    plant = Plant(rig=Coupon()).with_effects(Creep())
    pull = np.r_[np.linspace(1.0, 3.0, 500), np.linspace(3.0, 1.0, 500)]
    assert largest_difference(plant, record(pull, start=0.0)) < 1e-8
