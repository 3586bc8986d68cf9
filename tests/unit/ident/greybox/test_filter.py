"""The plant linearised along its run, its Kalman likelihood and what entered, smoothed, against closed forms."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare
from runs import readings as simulated
from scipy.linalg import expm

from deatwin.ident.greybox import Part
from deatwin.ident.greybox.filter import Floor, Opening, filter_likelihood, latent, linearise, open_place
from deatwin.ident.greybox.filter_linear import without_repeats
from deatwin.ident.greybox.filter_openings import opened_equations, places
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.kalman import StateSpace, kalman_filter
from deatwin.plant import Delay, Diaphragm, Experiment, Parameter, Plant, Recording
from deatwin.plant.builder import Builder
from deatwin.plant.errors import ModelError

COMMAND = Opening(place="drive", signal="command")
DRIVE = tuple(Opening(place="drive", signal=name) for name in ("command", "amplifier_voltage", "squared_voltage"))
STEP = 0.02


def part_of(commands: np.ndarray, readings: np.ndarray) -> Part:
    return Part.whole(Experiment(recordings=(Recording.from_arrays(commands, readings, STEP),)))


@dataclass(frozen=True, kw_only=True)
class Saturated(Bare):
    """Written with functions of NumPy, of which CasADi warns at length."""

    kind: ClassVar[str] = "saturated"
    parameters: ClassVar[tuple[Parameter, ...]] = ()

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        build.rate(position, build.command - np.tanh(position) - np.maximum(position, 0.0))
        return position


@pytest.mark.filterwarnings("error")
def test_a_rig_with_functions_of_numpy_is_opened_without_a_word() -> None:
    plant = Plant(rig=Saturated())
    assert COMMAND in places(plant)
    assert opened_equations(plant, [COMMAND], []).states == ("position",)


def test_opened_equations_are_solved_with_the_stages_of_their_plant() -> None:
    """A late reading has one moment for each stage."""
    plant = Plant(rig=Diaphragm(), effects=(Delay().placed("reading"),), stages=4)
    opened = opened_equations(plant, [], [])
    assert opened.stages == 4 and opened.states == plant.equations.states
    assert places(plant)


@pytest.mark.parametrize(("stiffness", "steps"), [(400.0, 1), (400.0 * 10.0**2, 8)])
def test_the_step_of_a_linear_plant_is_its_matrix_exponential(oscillator, stiffness: float, steps: int):
    plant = Plant(rig=oscillator(), values={"stiffness": stiffness}, steps=steps)
    commands = np.random.default_rng(0).standard_normal(30)
    (linear,) = linearise(plant, [part_of(commands, np.zeros(30))])
    # held force on mass 1, damping 2 and a spring: exp of the system and its input together
    system = np.zeros((3, 3))
    system[:2] = [[0.0, 1.0, 0.0], [-stiffness, -2.0, 1.0]]
    exact = expm(STEP * system)
    # the integrator follows a mode of 20 rad/s to ninth order: (0.4)^9/9! = 7e-10; and in each of eight steps one of
    # 200 rad/s: (0.5)^9/9! = 5e-9, where speeds are 200 times as large as positions
    tolerance = 1e-8 * steps * stiffness / 400.0
    np.testing.assert_allclose(linear.transition[7], exact[:2, :2], atol=tolerance)
    number = linear.openings.index(COMMAND)
    np.testing.assert_allclose(linear.entering[7, :, number], exact[:2, 2], atol=1e-8 * steps)
    np.testing.assert_allclose(linear.rows[7], exact[0, :2], atol=1e-8 * steps)


def test_a_nonlinear_plant_answers_as_finite_differences_say():
    plant = Plant(rig=Diaphragm())
    commands = 2.0 + np.sin(0.3 * np.arange(120))
    readings = simulated(plant, commands)
    (linear,) = linearise(plant, [part_of(commands, readings)], DRIVE)
    assert np.nanmax(np.abs(linear.residual)) < 1e-12
    pulse = np.zeros(120)
    pulse[40] = 1e-4
    difference = (simulated(plant, commands + pulse) - simulated(plant, commands - pulse)) / 2
    entering = np.zeros((linear.residual.size, 1))
    entering[-120:, 0] = pulse
    answer = linear.response(linear.openings.index(COMMAND), entering)[-120:, 0]
    # central differences err by the square of the step: 1e-4 V of 2 V
    np.testing.assert_allclose(answer, difference, atol=1e-6 * np.abs(difference).max())


def test_constant_parameters_act_as_in_a_free_run():
    plant = Plant(rig=Diaphragm())
    commands = 2.0 + np.sin(0.3 * np.arange(100))
    part = part_of(commands, simulated(plant, commands))
    (linear,) = linearise(plant, [part], DRIVE)
    problem = Problem(plant=plant, parts=(part,), names=tuple(plant.parameters.free))
    jacobian = problem.evaluate(problem.start())[1]
    found = linear.parameter_response()
    scale = np.abs(jacobian).max(axis=0)
    np.testing.assert_allclose(found[linear.counted] / scale, jacobian / scale, atol=1e-9)
    # joined samples: the means of the same
    joined = linear.joined(3)
    full = np.where(linear.counted[:, None], found, 0.0)
    starts = 3 * np.arange(joined.residual.size)
    means = np.add.reduceat(full, starts) / np.maximum(joined.counts, 1)[:, None]
    np.testing.assert_allclose(
        joined.parameter_response()[joined.counted] / scale, means[joined.counted] / scale, atol=1e-9
    )


@pytest.mark.parametrize("size", [1, 4])
def test_the_likelihood_is_that_of_one_large_normal_law(oscillator, size):
    plant = Plant(rig=oscillator())
    rng = np.random.default_rng(1)
    commands = rng.standard_normal(80)
    readings = simulated(plant, commands) + 1e-3 * rng.standard_normal(80)
    (linear,) = linearise(plant, [part_of(commands, readings)], [COMMAND])
    joined = linear.joined(size)
    floor = Floor(noise=1e-3, model_error=4e-4, memory=0.3)
    found = filter_likelihood([joined], floor, COMMAND, amplitude=0.5, memory=0.2)

    n, k = joined.residual.size, np.arange(joined.residual.size)
    answers = joined.response(0, np.eye(n))
    constant = joined.parameter_response()

    def wander(amplitude: float, memory: float) -> np.ndarray:
        kept = np.exp(-joined.interval / memory)
        earlier = np.minimum(k[:, None], k)
        return amplitude**2 * kept ** np.abs(k[:, None] - k) * (1 - kept ** (2 * earlier))

    law = constant * joined.prior @ constant.T + answers @ wander(0.5, 0.2) @ answers.T + wander(4e-4, 0.3)
    law += np.diag(1e-6 / joined.counts)
    _, log_determinant = np.linalg.slogdet(2 * np.pi * law)
    exact = -0.5 * (log_determinant + joined.residual @ np.linalg.solve(law, joined.residual))
    # both in double precision; the law's condition number is about 1e5
    assert found.log_likelihood == pytest.approx(exact, rel=1e-8)


def test_amplitude_and_course_of_what_entered_are_found(oscillator):
    plant = Plant(rig=oscillator())
    rng = np.random.default_rng(2)
    n, memory, amplitude = 2000, 0.5, 0.3
    kept = np.exp(-STEP / memory)
    entered = np.zeros(n)
    for i in range(1, n):
        entered[i] = kept * entered[i - 1] + amplitude * np.sqrt(1 - kept**2) * rng.standard_normal()
    commands = rng.standard_normal(n)
    noise = 2e-5
    readings = simulated(plant, commands + entered) + noise * rng.standard_normal(n)
    part = part_of(commands, readings)
    linears = linearise(plant, [part], [COMMAND])
    floor = Floor(noise=noise)
    opened = open_place(linears, floor, COMMAND)
    # 40 s hold 40 independent values of a memory of half a second: 1/sqrt(80) = 11 % deviation of the amplitude
    assert opened.amplitude == pytest.approx(amplitude, rel=0.35)
    assert opened.log_likelihood > open_place(linears, floor, None).log_likelihood + 100
    found = latent(plant, [part], COMMAND, floor=floor, opened=opened)
    inside = np.abs(found.mean - entered) < 2 * found.deviation
    # 95 % of 2000 values, of which about 100 are independent: two deviations are 4 %
    assert inside.mean() > 0.9
    assert set(found.states) == {"force", "position", "velocity"}


def test_openings_that_do_the_same_are_one():
    plant = Plant(rig=Diaphragm())
    commands = 2.0 + np.sin(0.3 * np.arange(60))
    linears = linearise(plant, [part_of(commands, np.zeros(60))], DRIVE)
    kept = {o.name for o in without_repeats(linears)[0].openings}
    # the amplifier's voltage is a multiple of the command; the squared voltage is not
    assert {"drive.command", "drive.squared_voltage"} <= kept
    assert "drive.amplifier_voltage" not in kept


def test_an_opening_must_be_among_those_of_the_linearisation(oscillator):
    plant = Plant(rig=oscillator())
    linears = linearise(plant, [part_of(np.ones(10), np.zeros(10))], [COMMAND])
    with pytest.raises(ModelError, match=r"sensor.reading cannot be opened.*drive.command"):
        filter_likelihood(linears, Floor(noise=1.0), Opening(place="sensor", signal="reading"))


def test_a_state_that_dies_away_without_a_measurement_leaves_the_filter_sound():
    n = 1500
    outputs = np.full(n, np.nan)
    outputs[-1] = 1.0
    model = StateSpace(
        rows=np.ones((n, 2)),
        noise_variance=1.0,
        start=np.zeros(2),
        start_cov=np.eye(2),
        transition=np.diag([0.5, 0.9]),
        process_cov=np.diag([0.0, 0.19]),
    )
    # the first state's deviation falls to 0.5^1500, through the numbers whose squares are too small to be inverted
    assert kalman_filter(model, outputs).innovation_variances[0, -1] == pytest.approx(2.0, rel=1e-12)
