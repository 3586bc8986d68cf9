"""NARX models as nonlinear systems of python-control."""

import control
import numpy as np
import pytest
from made_models import controller_of

from deatwin.control.controllers.law import Law
from deatwin.control.errors import ControlError
from deatwin.control.interop.narx_system import past_state
from deatwin.control.interop.systems import in_loop, rest_state_of, to_nlsys
from deatwin.control.linear.narx import linearise
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError, Recording, SimulationError

H = 0.02
CUBIC = {"1": 0.1, "y(k-1)": 0.6, "y(k-2)": 0.2, "u(k)": 0.3, "u(k-3)": 0.2, "y(k-1)^3": -0.05, "u(k)u(k-1)y(k-2)": 0.1}
TWO_INPUTS = {"y(k-2)": 0.5, "u1(k-1)": 1.0, "u2(k)": 0.4, "u1(k-2)u2(k-1)": -0.3, "u2(k-1)^3": 0.1}
TWO_OUTPUTS = {
    "y1": {"y1(k-1)": 0.6, "y2(k-2)": 0.2, "u(k)": 0.5, "y1(k-1)^2": -0.1},
    "y2": {"y2(k-1)": 0.4, "y1(k-1)": 0.3, "u(k-1)": 0.2, "1": -0.1},
}
NOISY = {"y(k-1)": 0.7, "u(k-1)": 1.0, "e(k-1)": 0.5, "u(k-1)e(k-2)": 0.2}


def made(terms, **details):
    return NarxModel.from_terms(terms, sample_time=H, **details)


def recording_for(model, rng, count=300):
    inputs = rng.uniform(-1.0, 1.0, (len(model.input_names), count))
    outputs = rng.uniform(-0.5, 0.5, (model.n_outputs, count))
    return Recording(
        inputs=inputs,
        outputs=outputs,
        sample_time=H,
        input_names=model.input_names,
        output_names=model.output_names,
        input_units=model.input_units,
        output_units=model.output_units,
    )


NO_OUTPUTS, STATIC = {"u(k)^2": 2.0, "u(k-1)": 1.0}, {"u(k)^2": 2.0}


@pytest.mark.parametrize("terms", [CUBIC, TWO_INPUTS, TWO_OUTPUTS, NOISY, NO_OUTPUTS, STATIC])
def test_it_runs_as_the_model_runs_free(terms):
    model = made(terms)
    recording = recording_for(model, np.random.default_rng(5))
    expected, first = model.simulate(recording), model.table.max_lag
    start = past_state(model, recording.inputs[:, :first], recording.outputs[:, :first])
    response = control.input_output_response(
        to_nlsys(model), recording.timepts[first:], recording.inputs[:, first:], start, squeeze=False
    )
    # Rounding of sums and products in another order.
    np.testing.assert_allclose(response.outputs, expected.outputs[:, first:], rtol=1e-12, atol=1e-14)


def test_it_carries_the_names_and_only_the_states_that_it_needs():
    model = made(TWO_INPUTS, input_names=("command", "temperature"), output_names=("displacement",))
    system = to_nlsys(model, "film")
    assert system.name == "film"
    assert system.dt == H
    assert system.input_labels == ["command", "temperature"]
    assert system.output_labels == ["displacement"]
    assert system.state_labels == [
        "displacement(k-1)",
        "displacement(k-2)",
        "command(k-1)",
        "command(k-2)",
        "temperature(k-1)",
    ]


def test_a_model_without_memory_is_a_static_function():
    system = to_nlsys(made(STATIC))
    assert system.nstates == 0
    assert system(3.0) == 18.0


@pytest.mark.parametrize("point", [0.0, 0.5])
def test_python_control_linearises_it_as_deatwin_does(point):
    model, omega = made(CUBIC), np.array([0.1, 1.0, 10.0, 100.0])
    linear = linearise(model, point)
    about = control.linearize(to_nlsys(model), rest_state_of(model, point), point)
    # Forward differences of 1e-6 at curvatures of order 1.
    np.testing.assert_allclose(about(np.exp(1j * omega * H)), linear.response(omega), rtol=1e-5)


def test_it_stays_at_rest():
    model = made(CUBIC)
    state = rest_state_of(model, 0.5)
    response = control.input_output_response(to_nlsys(model), H * np.arange(200), 0.5 * np.ones(200), state)
    np.testing.assert_allclose(response.outputs, linearise(model, 0.5).rest_output, rtol=1e-12)


def test_read_one_sample_later_it_closes_a_loop_without_an_algebraic_one():
    terms, gain, count = {"y(k-1)": 0.5, "u(k)": 1.0, "y(k-1)^3": -0.1}, 0.4, 50
    law = Law.of_error([[1.0]], [gain], [1.0], 0.3)
    controller = controller_of(law, np.array([0.5]), command_min=-0.05, command_max=0.6)
    film, pi = in_loop(to_nlsys(made(terms)), "film"), controller.to_control()
    loop = control.interconnect(
        [film, pi],
        connections=[["film.input", "PI.command"], ["PI.reading", "film.output"]],
        inplist=["PI.reference"],
        outlist=["film.output", "PI.command"],
    )
    reference = np.where(np.arange(count) < 25, 0.8, -0.2)
    response = control.input_output_response(loop, H * np.arange(count), reference)

    reading, memory, expected = 0.0, controller.start(), []
    for wanted in reference:
        command, memory = controller.command(wanted, reading, memory)
        expected.append((reading, float(command)))
        reading = 0.5 * reading + float(command) - 0.1 * reading**3
    np.testing.assert_allclose(response.outputs, np.transpose(expected), rtol=1e-12, atol=1e-14)
    assert (response.outputs[1] == 0.6).any() and (response.outputs[1] == -0.05).any()

    with pytest.raises(RuntimeError, match="algebraic loop"):
        control.interconnect(
            [to_nlsys(made(terms), "film"), pi],
            connections=[["film.input", "PI.command"], ["PI.reading", "film.output"]],
            inplist=["PI.reference"],
            outlist=["film.output"],
        ).output(0.0, np.zeros(2), 1.0)


def test_one_sample_later_is_what_a_linear_model_in_the_loop_sees(plant):
    model, omega = made({"y(k-1)": 0.5, "u(k)": 2.0}), np.array([1.0, 50.0])
    seen = control.linearize(in_loop(to_nlsys(model)), np.zeros(2), 0.0)
    expected = linearise(model).in_loop(plant.rig.reading)
    np.testing.assert_allclose(seen(np.exp(1j * omega * H)), expected.response(omega), rtol=1e-8)


def test_divergence_is_one_clear_error_with_its_time():
    system = to_nlsys(made({"y(k-1)": 1.2, "y(k-1)^3": 1.0, "u(k-1)": 1.0}))
    with pytest.raises(SimulationError, match="diverges at"):
        control.input_output_response(system, H * np.arange(500), np.ones(500))


def test_bad_input_is_one_clear_error():
    model = made(TWO_INPUTS)
    system, timepts = to_nlsys(model), H * np.arange(10)
    with pytest.raises(SimulationError, match="not a finite number"):
        control.input_output_response(system, timepts, np.full((2, 10), np.nan))
    with pytest.raises(ValueError, match="X0"):
        control.input_output_response(system, timepts, np.zeros((2, 10)), np.ones(9))
    with pytest.raises(ModelError, match="2 inputs and 1 outputs, and needs at least 2 samples of each"):
        past_state(model, np.zeros((2, 1)), np.zeros(1))
    with pytest.raises(ModelError, match="2 inputs and 1 outputs"):
        past_state(model, np.zeros(5), np.zeros(5))
    with pytest.raises(ModelError, match="the last 2 samples of the inputs and outputs must be finite"):
        past_state(model, np.zeros((2, 5)), [0.0, 0.0, 0.0, np.nan, 0.0])
    assert np.isfinite(past_state(model, np.zeros((2, 5)), [np.nan, 0.0, 0.0, 0.0, 0.0])).all()
    with pytest.raises(ModelError, match="2 finite number"):
        rest_state_of(model, 1.0)
    with pytest.raises(ModelError, match="one output"):
        rest_state_of(made(TWO_OUTPUTS), 1.0)
    with pytest.raises(ModelError, match="at least one term"):
        to_nlsys(made({"e(k-1)": 0.5}))
    with pytest.raises(ControlError, match="neither a NarxModel nor a Plant"):
        to_nlsys(control.tf([1], [1, 1]))
    with pytest.raises(ControlError, match="neither"):
        rest_state_of("plant", 1.0)
    with pytest.raises(ControlError, match="discrete"):
        in_loop(control.ss(-1.0, 1.0, 1.0, 0.0))
