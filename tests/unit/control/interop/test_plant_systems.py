"""The physics plant as a nonlinear system of python-control."""

from dataclasses import replace

import control
import numpy as np
import pytest
from made_models import controller_of

from deatwin.control.controllers.law import Law
from deatwin.control.errors import ControlError
from deatwin.control.interop.systems import in_loop, rest_state_of, to_nlsys
from deatwin.control.loop.closed_loop import closed_loop
from deatwin.plant import Coupon, Experiment, Plant, ReadingTime, Recording, SimulationError
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.small_signal import small_signals

H = 0.02
KINDS = {
    "base": (),
    "past commands and the clock": (Delay(),),
    "a held capacitance": (ElectrodeRC(),),
    "memory and drift": (Hysteresis(), PermittivityDrift()),
}

pytestmark = pytest.mark.usefixtures("uncompiled")


def experiment(count, seed=7):
    command = 2.4 + 0.4 * np.random.default_rng(seed).uniform(-1.0, 1.0, count)
    return Experiment(recordings=(Recording.from_arrays(command, np.zeros(count), H, start=5.0),))


def clock(timeline):
    return timeline.start + timeline.sample_time * np.arange(timeline.commands.size)


@pytest.mark.parametrize(
    ("reading", "effects"),
    [
        *((ReadingTime.END_OF_HOLD, effects) for effects in KINDS.values()),
        *((reading, (Delay(),)) for reading in ReadingTime if reading is not ReadingTime.END_OF_HOLD),
    ],
)
def test_it_runs_as_the_plant_does_from_rest_through_the_start_procedure(plant, effects, reading):
    actuator = plant.with_rig(replace(plant.rig, reading=reading)).with_effects(*effects)
    given = experiment(60)
    timeline = actuator.timeline(given)
    response = control.input_output_response(to_nlsys(actuator), clock(timeline), timeline.commands)
    rows = slice(timeline.commands.size - 60, None)
    expected = actuator.simulate(given).require().outputs[0][0]
    # Both take the same steps; Newton's method starts from states that differ by rounding.
    assert np.abs(response.outputs[rows] - expected).max() < 1e-11 * np.ptp(expected)


def test_it_is_named_as_the_rig_is(plant):
    system = to_nlsys(plant.with_effects(Delay()), "actuator")
    assert (system.name, system.dt) == ("actuator", H)
    assert (system.input_labels, system.output_labels) == (["command"], ["displacement"])
    equations = plant.with_effects(Delay()).equations
    assert system.state_labels[: len(equations.states)] == list(equations.states)
    assert system.nstates == equations.scale.size + equations.history


@pytest.mark.parametrize("effects", KINDS.values(), ids=KINDS)
def test_at_rest_it_stays(plant, effects):
    actuator = plant.with_effects(*effects)
    state = rest_state_of(actuator, 2.4)
    response = control.input_output_response(to_nlsys(actuator), H * np.arange(5), 2.4 * np.ones(5), state)
    # The drift moves it by its own: what is left is far below the sensor's noise.
    assert np.ptp(response.outputs) < (1e-8 if "drift" in str(actuator.effect_names) else 1e-15)


@pytest.mark.parametrize("effects", [(), (Delay(),), (ElectrodeRC(),)])
def test_python_control_linearises_it_as_deatwin_does(plant, effects):
    actuator = plant.with_effects(*effects)
    small = small_signals(actuator, [2.4])[0]
    about = control.linearize(to_nlsys(actuator), rest_state_of(actuator, 2.4), 2.4)
    at = np.exp(1j * H * 2 * np.pi * np.geomspace(0.01, 25.0, 20))
    lags = at[:, None] ** -np.arange(small.d.size)
    eye = np.eye(len(small.a))
    states = [np.linalg.solve(z * eye - small.a, small.b @ row) for z, row in zip(at, lags, strict=True)]
    expected = np.array(states) @ small.c + lags @ small.d
    # Forward differences of 1e-6 in states of order 1, on a film whose answer doubles within a volt.
    np.testing.assert_allclose(about(at), expected, rtol=1e-5)


def test_a_loop_of_python_control_is_the_closed_loop_on_the_plant(plant):
    quiet = plant.with_rig(replace(plant.rig, noise=0.0))
    rest = rest_state_of(quiet, 2.4)
    level = float(to_nlsys(quiet).output(0.0, rest, 2.4)[0])
    gain = 2e3  # V/m and sample: a tenth of the slope's inverse
    controller = controller_of(
        Law.of_error([[1.0]], [gain], [1.0], gain),
        np.array([1.0]),
        operating_input=2.4,
        operating_output=level,
        command_min=1.1,
        command_max=3.0,
    )
    reference = level + np.repeat([0.0, 60e-6, -30e-6], 30)
    expected = closed_loop(quiet, controller, reference, rng=np.random.default_rng(0), settle=1.0)

    system, still = to_nlsys(quiet), Recording.from_arrays(np.full(50, 2.4), np.zeros(50), H)
    timeline = quiet.timeline(Experiment(recordings=(still,)))
    times = clock(timeline)
    before = control.input_output_response(system, times, timeline.commands)
    begin = system.dynamics(times[-1], before.states[:, -1], 2.4)
    actuator = in_loop(system, "actuator")
    loop = control.interconnect(
        [actuator, controller.to_control()],
        connections=[["actuator.command", "PI.command"], ["PI.reading", "actuator.displacement"]],
        inplist=["PI.reference"],
        outlist=["actuator.displacement", "PI.command"],
    )
    start = np.concatenate([begin, before.outputs[-1:], controller.start()])
    response = control.input_output_response(loop, times[-1] + H * np.arange(1, 91), reference, start)
    # The same steps from the same state, but for rounding that the loop damps.
    np.testing.assert_allclose(response.outputs[0], expected.output, atol=1e-12)
    np.testing.assert_allclose(response.outputs[1], expected.command, atol=1e-8)
    assert np.ptp(expected.output) > 30e-6


def test_a_plant_without_memory_is_a_static_function():
    coupon = Plant(rig=Coupon())
    stretches = np.linspace(1.0, 1.5, 20)
    system = to_nlsys(coupon)
    response = control.input_output_response(system, coupon.rig.sample_time * np.arange(20), stretches)
    given = Experiment(recordings=(Recording.from_arrays(stretches, np.zeros(20), coupon.rig.sample_time, start=5.0),))
    np.testing.assert_allclose(response.outputs, coupon.simulate(given).require().outputs[0][0], rtol=1e-12)
    assert system(1.5) == pytest.approx(response.outputs[-1])
    assert system.nstates == 0 and rest_state_of(coupon, 1.2).size == 0


def test_pull_in_is_one_clear_error_with_time_and_command(plant):
    with pytest.raises(SimulationError, match=r"stops at \d.* command of 20 V: .*pull-in"):
        control.input_output_response(to_nlsys(plant), H * np.arange(50), np.full(50, 20.0))
    with pytest.raises(SimulationError, match="no rest in reach at a command of 20 V"):
        rest_state_of(plant, 20.0)


def test_bad_input_is_one_clear_error(plant):
    system = to_nlsys(plant)
    for wrong in (np.nan, [1.0, 2.0]):
        with pytest.raises(ControlError, match="one finite command"):
            rest_state_of(plant, wrong)
    with pytest.raises(SimulationError, match="not finite"):
        control.input_output_response(system, H * np.arange(3), np.full(3, np.nan))
    with pytest.raises(ValueError, match="X0"):
        control.input_output_response(system, H * np.arange(3), np.zeros(3), np.ones(9))
    with pytest.raises(SimulationError, match="none of the plant's"):
        control.input_output_response(system, H * np.arange(3), np.zeros(3), -50.0 * np.ones(system.nstates))
    with pytest.raises(SimulationError, match="no state of rest"):
        to_nlsys(plant.with_values({"mass": 1.0}))
