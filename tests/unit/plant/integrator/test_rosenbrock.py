"""The Rosenbrock integrator against SUNDIALS and the order of its scheme."""

import numpy as np
import pytest
from sundials import reference_outputs

from deatwin.plant import Delay, Diaphragm, Experiment, Plant, Recording
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.integrator.rosenbrock import integrate

STEP = 0.02


def silent(commands):
    return Experiment(recordings=(Recording.from_arrays(commands, np.zeros(commands.size), STEP),))


def test_the_integrator_refuses_equations_that_divide_a_sample():
    late = Plant(rig=Diaphragm(ball="bonded")).with_effects(Delay())
    inputs = late.equations.held_inputs(0.0)[:, None]
    with pytest.raises(ValueError, match="divide a sample"):
        integrate(late.equations, late.free_values, np.zeros(1), inputs, np.array([0.02]))


@pytest.mark.parametrize("resolution", ["reduced", "fine"])
def test_the_integrator_agrees_with_sundials(resolution):
    plant = Plant(rig=Diaphragm(ball="bonded", resolution=resolution, elements=2))
    experiment = silent(band_limited_noise(np.random.default_rng(0), 3.0, STEP))
    timeline = plant.timeline(experiment)
    times = timeline.start + STEP * np.arange(timeline.commands.size)
    reads = np.concatenate([[timeline.start], timeline.start + STEP * (timeline.readings[0] + 1)])
    inputs = plant.equations.inputs(timeline.commands, 0.0, times)
    found = integrate(plant.equations, plant.free_values, times, inputs, reads).outputs
    mine = found[1:] - found[0]
    (reference,) = reference_outputs(plant, experiment, 1e-9)
    # A hundredth of the smallest noise of the study (1 % of some 100 µm).
    assert np.abs(mine - reference[0]).max() < 0.03e-6
    assert np.ptp(mine) > 100e-6


def test_the_integrator_has_the_order_of_its_scheme():
    """Its estimate of order 3 goes with the fourth power of a step: 256 times the tolerance, a quarter the steps."""
    plant, experiment = Plant(rig=Diaphragm(ball="bonded")), silent(np.full(100, 2.5))
    timeline = plant.timeline(experiment)
    # One jump, then nothing: long free steps.
    times, commands = timeline.start + np.array([0.0, 1.0]), np.array([0.0, 2.5])
    reads = np.array([timeline.start + 4.0])
    steps = [
        integrate(
            plant.equations,
            plant.free_values,
            times,
            plant.equations.inputs(commands, 0.0, times),
            reads,
            tolerance=tolerance,
        ).steps
        for tolerance in (1e-10, 256e-10)
    ]
    assert 2.8 < steps[0] / steps[1] < 5.0
