"""The stepper of the physics plant, and the closed loop around it."""

from dataclasses import replace

import numpy as np
import pytest
from stopping import StopAt

from deatwin.control import ControlError, closed_loop, lambda_tuning, linearise, sine_reference, step_reference
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.loop.closed_loop import at_operating_point
from deatwin.plant import Experiment, RunStatus, SimulationError
from deatwin.plant.fleet import specification

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
    late = [run.error[part.stop - 80 : part.stop].mean() for part in run.levels]
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
    feedback = controller.local(linear.operating_input).feedback_response(omega, H)[0]
    predicted = 40e-6 / np.sqrt(2) / np.abs(1 + feedback * linear.response(omega)[0])
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
    first, second = (closed_loop(plant, controller, reference, rng=np.random.default_rng(9)) for _ in range(2))
    np.testing.assert_array_equal(first.measured, second.measured)
    assert np.std(first.measured - first.output) == pytest.approx(plant.rig.noise, rel=0.3)


@pytest.fixture(scope="module")
def chained():
    """The thesis' plant with drive and sensor, and a controller for it from its own linear model."""
    plant = specification()
    linear = linearise_plant(plant, 2.4).in_loop(plant.rig.reading)
    return plant, linear, lambda_tuning(linear, command_limits=(1.1, 3.75), closed_loop_time=0.3)


def test_a_measuring_chain_reads_in_codes_with_its_lag(chained):
    plant, linear, controller = chained
    chain = plant.rig.chain
    reference = step_reference(linear.operating_output, 60e-6, 60)
    run = closed_loop(plant, controller, reference, rng=np.random.default_rng(6))
    codes = run.measured / chain.reading_step
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-6)
    # The laser looks back by its lag, and rounds to its resolution, the input to its codes.
    lag = chain.laser.lag / H
    seen = run.output.copy()
    seen[1:] = (1 - lag) * run.output[1:] + lag * run.output[:-1]
    left = run.measured - seen
    assert left.std() == pytest.approx(chain.noise, rel=0.25)
    assert np.abs(left).max() < 6 * chain.noise
    again = closed_loop(plant, controller, reference, rng=np.random.default_rng(6))
    assert run.to_dict() == again.to_dict()


def test_the_drive_gives_the_nearest_code(chained, monkeypatch):
    """The plant gets what the output makes of the command: a step of its codes tells the two apart."""
    plant, linear, controller = chained
    coarse = replace(plant.rig.chain, analogue_output=replace(plant.rig.chain.analogue_output, bits=6))
    rig = plant.with_rig(replace(plant.rig, chain=coarse))
    reference = step_reference(linear.operating_output, 60e-6, 30)
    run = closed_loop(rig, controller, reference, rng=np.random.default_rng(6))
    step = coarse.analogue_output.step
    assert step > 0.1  # V
    stepper = at_operating_point(rig, 2.4, 100)
    for command, output in zip(run.command, run.output, strict=True):
        assert stepper.reading == pytest.approx(output, rel=1e-9)
        stepper.advance(float(step * np.round(command / step)))


def test_a_plant_that_has_no_rest_is_a_run_of_no_samples(plant, controller):
    run = closed_loop(plant.with_values({"mass": 1.0}), controller, np.zeros(9), rng=np.random.default_rng(0))
    assert run.status is RunStatus.NO_REST
    assert run.timepts.size == run.output.size == 0
    assert run.rms_error == run.saturated_share == run.effort == run.overshoot == 0.0


def test_progress_is_told_and_may_end_the_run(plant, controller, linear):
    shares = []
    reference = np.full(350, linear.operating_output)
    closed_loop(plant, controller, reference, rng=np.random.default_rng(0), progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    with pytest.raises(KeyboardInterrupt):
        closed_loop(plant, controller, reference, rng=np.random.default_rng(0), progress=StopAt(1))


def test_a_controller_of_another_sample_time_is_refused(plant, controller):
    with pytest.raises(ControlError, match=r"0\.01 s"):
        closed_loop(plant, replace(controller, sample_time=0.01), np.zeros(5), rng=np.random.default_rng(0))
