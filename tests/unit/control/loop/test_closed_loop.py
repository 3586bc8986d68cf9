"""The stepper of the physics plant, and the closed loop around it."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.control import (
    ControlError,
    closed_loop,
    lambda_tuning,
    linearise,
    sine_reference,
    step_reference,
)
from deatwin.plant import Experiment, RunStatus, SimulationError

H = 0.02


@pytest.fixture(scope="module")
def linear(model, plant):
    return linearise(model).in_loop(plant.rig.reading)


@pytest.fixture(scope="module")
def controller(linear):
    return lambda_tuning(linear, command_limits=(1.1, 3.75), band_Hz=1.0)


def start(plant, **values):
    return plant.with_values(values).simulator.stepper(
        plant.with_values(values).free_values, rest_command=0.0, start=0.0, sample_time=H
    )


def test_stepping_equals_the_simulation(plant, recording):
    part = recording.section(0, 200)
    expected = plant.simulate(Experiment(recordings=(part,))).outputs[0][0]
    timeline = plant.timeline(Experiment(recordings=(part,)))
    stepper, readings = start(plant), []
    for command in timeline.commands:
        assert stepper.advance(command) is RunStatus.DONE
        readings.append(stepper.reading)
    np.testing.assert_allclose(np.array(readings)[timeline.readings[0]], expected, atol=1e-12)
    assert stepper.time == pytest.approx(timeline.commands.size * H)


def test_pull_in_is_a_status_and_keeps_the_last_reading(plant):
    stepper = start(plant)
    for _ in range(50):
        stepper.advance(20.0)
    assert stepper.status is RunStatus.PULL_IN
    assert np.isfinite(stepper.reading)
    assert stepper.time < 1.0


def test_no_rest_is_a_status(plant):
    stepper = start(plant, mass=1.0)
    assert stepper.advance(1.0) is RunStatus.NO_REST
    with pytest.raises(SimulationError, match="rest"):
        _ = stepper.reading


def test_steps_end_on_the_reference_within_noise(plant, controller, linear):
    reference = step_reference(linear.operating_output, 50e-6, 250)
    run = closed_loop(plant, controller, reference, rng=np.random.default_rng(4))
    assert run.status is RunStatus.DONE
    assert run.timepts.shape == run.command.shape == (1250,)
    assert np.all((run.command >= 1.1) & (run.command <= 3.75))
    late = [run.error[part.stop - 80 : part.stop].mean() for part in run.plateaus]
    # The mean of 80 readings; a controller that integrates follows it.
    assert np.abs(late).max() < 4 * plant.rig.noise / np.sqrt(80) + 1e-3 * 50e-6
    assert run.overshoot < 0.1
    assert run.steady_error < 0.03
    assert run.saturated_share == 0.0


def test_sine_error_is_what_the_model_predicts(plant, controller, linear):
    frequency = 0.1
    reference = sine_reference(linear.operating_output, 40e-6, frequency, H, 4)
    run = closed_loop(plant, controller, reference, rng=np.random.default_rng(4))
    omega = [2 * np.pi * frequency]
    predicted = 40e-6 / np.sqrt(2) / np.abs(1 + controller.response(omega)[0] * linear.response(omega)[0])
    assert np.sqrt(np.mean(run.error[500:] ** 2)) == pytest.approx(predicted, rel=0.2)


def test_limits_are_respected_when_the_reference_is_out_of_reach(plant, controller, linear):
    narrow = replace(controller, command_min=2.3, command_max=2.5)
    reference = step_reference(linear.operating_output, 100e-6, 100)
    run = closed_loop(plant, narrow, reference, rng=np.random.default_rng(4))
    assert run.status.ok
    assert run.command.min() == 2.3
    assert run.command.max() == 2.5
    assert run.saturated_share > 0.2


def test_the_noise_comes_from_the_generator_alone(plant, controller, linear):
    reference = step_reference(linear.operating_output, 20e-6, 20)
    first, second = (
        closed_loop(plant, controller, reference, rng=np.random.default_rng(9)) for _ in range(2)
    )
    np.testing.assert_array_equal(first.measured, second.measured)
    assert np.std(first.measured - first.output) == pytest.approx(plant.rig.noise, rel=0.3)


def test_a_controller_of_another_sample_time_is_refused(plant, controller):
    with pytest.raises(ControlError, match=r"0\.01 s"):
        closed_loop(plant, replace(controller, sample_time=0.01), np.zeros(5), rng=np.random.default_rng(0))
