"""Runs: sensitivities, failures with a status, and the clock."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_rigs import Pushed
from slopes import differences

from deatwin.plant import Delay, Diaphragm, ElectrodeRC, Plant, ReadingTime, RunStatus, SimulationError
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.excitation import band_limited_noise

# A film that never stiffens gives way.
SOFT = Plant(rig=Diaphragm(), values={"shear_modulus": 8e3, "stretch_limit": 1e4})

pytestmark = pytest.mark.usefixtures("uncompiled")


def commands(duration=8.0, seed=3):
    return band_limited_noise(np.random.default_rng(seed), duration, 0.02)


def run(plant, inputs, values):
    simulator, rig = plant.simulator, plant.rig
    return simulator.run(
        inputs, start=-0.4, sample_time=rig.sample_time, rest_command=rig.start.rest_command, values=values
    )


def test_sensitivities_of_a_linear_system_are_exact(oscillator):
    # Static: x = F/k, dx/dk = -F/k²; after 10 s the motion has died to exp(-10).
    plant = Plant(rig=oscillator(), values={"damping": 20.0})
    done = plant.simulator.run_with_sensitivities(
        np.full(500, 4.0), start=0.0, sample_time=0.02, rest_command=0.0, values=plant.free_values
    )
    assert done.outputs[-1] == pytest.approx(4.0 / 400, rel=1e-9)
    np.testing.assert_allclose(done.sensitivities[-1], [0.0, 0.0, -4.0 / 400**2], atol=1e-12)


@pytest.mark.parametrize(
    "effects", [(), (Delay(time=0.013),), (Delay(time=0.013).placed("reading"),), (SensorLag(time=0.01),)]
)
def test_several_steps_per_sample_follow_a_fast_mode_and_its_sensitivities(effects):
    """A mode of four radians a sample; chunks of 200 steps end within a sample."""
    coarse = Plant(rig=Pushed(), values={"mass": 0.01, "damping": 0.2, "stiffness": 400.0}).with_effects(*effects)
    plant, finer = replace(coarse, steps=3), replace(coarse, steps=12)
    held = np.repeat(np.random.default_rng(2).uniform(0.0, 60.0, 25), 10)
    run = partial(plant.simulator.run, held, start=0.0, sample_time=0.02, rest_command=0.0)
    values = plant.free_values
    found = plant.simulator.run_with_sensitivities(held, **run.keywords, values=values)
    np.testing.assert_allclose(found.outputs, run(values=values).outputs, rtol=0, atol=1e-12)
    exact = finer.simulator.run(held, **run.keywords, values=values).outputs
    # A step of five stages and 1.3 radians has an error of (1.3)^10 5!4!/(10! 9!) = 3e-8 of the amplitude.
    np.testing.assert_allclose(found.outputs, exact, rtol=0, atol=1e-6 * np.ptp(exact))
    slopes = differences(lambda moved: run(values=moved * values).outputs, np.ones(values.size), 1e-5)
    size = np.abs(slopes[:, values != 0]).max(axis=0)
    # Central differences err by the square of the step, and by rounding divided by it; coefficients of the polynomial of
    # a late reading enlarge the rounding by the condition number of a Hilbert matrix, 5e5.
    found_slopes = (found.sensitivities * values)[:, values != 0]
    np.testing.assert_allclose(found_slopes / size, slopes[:, values != 0] / size, rtol=0, atol=1e-5)


def test_pull_in_is_a_status_with_time_and_voltage(experiment):
    ramp = np.linspace(0.0, 3.75, 500)
    simulation = SOFT.simulate(experiment(ramp, start=5.0))
    assert simulation.status is RunStatus.PULL_IN
    assert 5.0 < simulation.failed_at < 15.0
    sample = round((simulation.failed_at - 5.0) / 0.02)
    assert simulation.failed_command == pytest.approx(ramp[sample])
    reading = simulation.outputs[0][0]
    assert np.isfinite(reading[:sample]).all()
    assert np.isnan(reading[sample:]).all()
    assert simulation.events[-1].status is RunStatus.PULL_IN
    assert simulation.events[-1].time == pytest.approx(simulation.failed_at)
    said = rf"at {simulation.failed_at:.2f} s and a command of .*mm from the middle.*pull-in"
    with pytest.raises(SimulationError, match=said):
        simulation.require()


def test_a_failed_run_with_sensitivities_says_the_same():
    ramp = np.linspace(0.0, 3.75, 500)
    plain = run(SOFT, ramp, SOFT.free_values)
    exact = SOFT.simulator.run_with_sensitivities(
        ramp, start=-0.4, sample_time=0.02, rest_command=0.0, values=SOFT.free_values
    )
    assert exact.status is plain.status is RunStatus.PULL_IN
    assert exact.failed_at == plain.failed_at
    assert len(exact.outputs) == len(exact.sensitivities) == plain.failed_at + 1


@pytest.mark.parametrize("seed", range(4))
def test_no_nan_without_a_status(seed, experiment):
    rng = np.random.default_rng(seed)
    values = {"shear_modulus": rng.uniform(5e3, 20e3), "stretch_limit": np.exp(rng.uniform(4, 9))}
    plant = Plant(rig=Diaphragm(), values=values)
    inputs = rng.uniform(0.0, 3.75, 8).repeat(25)
    simulation = plant.simulate(experiment(inputs))
    assert simulation.status.ok == np.isfinite(simulation.outputs[0]).all()


def test_progress_ends_at_one(base, experiment):
    shares = []
    base.simulate(experiment(commands()), progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_watched_signals_follow_the_readings(base, experiment):
    simulation = base.simulate(experiment(commands()))
    signals = simulation.watched[0]
    np.testing.assert_allclose(signals["film_voltage"], 800 * commands(), rtol=1e-12)
    np.testing.assert_allclose(signals["displacement"], simulation.outputs[0][0], atol=1e-15)


def test_watched_signals_are_those_at_the_time_of_the_reading(experiment):
    """Before the first command, the mass rests without a force; its position is the reading."""
    rig = Pushed(reading=ReadingTime.START_OF_HOLD)
    simulation = Plant(rig=rig).simulate(experiment(commands()))
    signals = simulation.watched[0]
    np.testing.assert_allclose(signals["displacement"], simulation.outputs[0][0], atol=1e-15)
    assert signals["velocity"][0] == signals["acting"][0] == 0.0
    np.testing.assert_array_equal(signals["acting"][1:], commands()[:-1])


@pytest.mark.parametrize("commands", [(3.0, 0.0, 3.0), (3.4, -1.5, 3.4)])
def test_samples_that_one_step_does_not_solve_are_taken_in_shorter_ones(commands):
    # a lag of 0.5 ms under samples of 20 ms, with a capacitance that falls to a half in between
    plant = Plant(rig=Diaphragm(contact_radius=1.5e-3)).with_effects(ElectrodeRC(time=5e-4, film_share=1.0))
    held = np.repeat(commands, 15)
    coarse = plant.simulator.run(held, start=0.0, sample_time=0.02, rest_command=0.0, values=plant.free_values)
    fine = plant.simulator.run(
        np.repeat(held, 50), start=0.0, sample_time=4e-4, rest_command=0.0, values=plant.free_values
    )
    assert coarse.status.ok
    assert fine.status.ok
    # a sample is forty times the lag, so the voltage's own course in it is not resolved: it is late or early by up
    # to a lag, 0.5 ms, in which the ball at 16 Hz does 5 % of its swing; a wrong branch would be off by all of it
    np.testing.assert_allclose(coarse.outputs, fine.outputs[::50], rtol=0, atol=0.05 * np.ptp(fine.outputs))
    sensitive = plant.simulator.run_with_sensitivities(
        held, start=0.0, sample_time=0.02, rest_command=0.0, values=plant.free_values
    )
    np.testing.assert_allclose(sensitive.outputs, coarse.outputs, rtol=0, atol=1e-12)


def test_what_begins_to_move_within_the_first_sample_does_so():
    """A cosine does not change at clock 0, but later in the sample; a lag follows it from rest, in closed form."""
    size, omega, lag, h = 20e-6, 2 * np.pi * 5.0, 0.01, 0.02
    effects = PeriodicDisturbance(amplitude=size, frequency=5.0), SensorLag(time=lag)
    plant = Plant(rig=Diaphragm()).with_effects(*effects)
    readings = plant.simulator.run(
        np.zeros(1), start=0.0, sample_time=h, rest_command=0.0, values=plant.free_values
    ).outputs
    gain = 1 / (1 + (omega * lag) ** 2)
    after = gain * (np.cos(omega * h) + omega * lag * np.sin(omega * h)) + (1 - gain) * np.exp(-h / lag)
    # Order 9 of the scheme: (h/lag)^10/10! = 3e-4, of which the constant of Radau's error is less than a thousandth.
    assert readings[1] - readings[0] == pytest.approx(size * (after - 1.0), rel=1e-6)
