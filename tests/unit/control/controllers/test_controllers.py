"""What holds for controllers of every kind."""

import json
import pickle

import control
import numpy as np
import pytest
from made_controllers import KINDS

from deatwin.control import ControlError, Law
from deatwin.control.controllers.document import controller_from_dict, controller_to_dict

H = 0.02


def driven(controller, reference, reading):
    """Commands of a controller that is fed with given series, one sample after the other."""
    state, commands = controller.start(), []
    for asked, seen in zip(reference, reading, strict=True):
        command, state = controller.command(asked, seen, state)
        commands.append(command)
    return np.array(commands)


def series(controller, shape, amplitude=0.02):
    rng = np.random.default_rng(1)
    return controller.operating_output + amplitude * rng.normal(size=(2, *shape))


@pytest.mark.parametrize("kind", KINDS)
def test_at_rest_it_holds_the_operating_input(made, kind):
    controller = made[kind]
    rest = np.full(20, controller.operating_output)
    np.testing.assert_allclose(driven(controller, rest, rest), controller.operating_input, rtol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("batch", [(3,), (2, 3)])
def test_many_loops_at_once_equal_one_by_one(made, kind, batch):
    controller = made[kind]
    reference, reading = series(controller, (60, *batch), amplitude=0.3)
    start = controller.start()
    state = np.broadcast_to(start.reshape(-1, *np.ones(len(batch), dtype=int)), (start.size, *batch))
    together = []
    for asked, seen in zip(reference, reading, strict=True):
        command, state = controller.command(asked, seen, state)
        together.append(command)
    for place in np.ndindex(batch):
        alone = driven(controller, reference[(..., *place)], reading[(..., *place)])
        np.testing.assert_allclose(np.array(together)[(..., *place)], alone, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_small_deviations_obey_the_local_law(made, kind):
    controller = made[kind]
    size = 1e-7  # so that what is of second order is 1e-7 of the answer
    reference, reading = series(controller, (50,), amplitude=size)
    law = controller.local(controller.operating_input).to_control(H)
    inputs = np.stack([reference, reading]) - controller.operating_output
    expected = np.ravel(control.forced_response(law, inputs=inputs).outputs)
    found = driven(controller, reference, reading) - controller.operating_input
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
def test_as_a_system_of_python_control_it_gives_the_same_commands(made, kind):
    controller = made[kind]
    reference, reading = series(controller, (80,), amplitude=2.0)  # into the limits
    expected = driven(controller, reference, reading)
    assert np.isin(expected, [controller.command_min, controller.command_max]).any()
    timepts = H * np.arange(80)
    found = control.input_output_response(
        controller.to_control(), timepts, np.stack([reference, reading]), controller.start()
    ).outputs
    np.testing.assert_allclose(np.ravel(found), expected, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_scaling_scales_the_feedback_and_nothing_else(made, kind):
    controller = made[kind]
    point = controller.operating_input
    before, after = controller.local(point), controller.scaled(1.7).local(point)
    np.testing.assert_allclose(after.feedback[0], 1.7 * before.feedback[0], rtol=1e-9)
    np.testing.assert_allclose(after.feedback[1], before.feedback[1], rtol=1e-12)
    rest = np.full(3, controller.operating_output)
    np.testing.assert_allclose(driven(controller.scaled(1.7), rest, rest), point, rtol=1e-14)


@pytest.mark.parametrize("kind", ["inverse", "falling"])
def test_scaling_leaves_what_is_fed_forward(made, kind):
    controller = made[kind]
    step = 0.1
    for factor in (1.0, 0.5, 3.0):
        # Reference and reading agree: only what is fed forward moves the command.
        at = controller.operating_output + step
        command, _ = controller.scaled(factor).command(at, at, controller.start())
        assert float(controller.curve.output(command)) == pytest.approx(at, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_document_makes_the_same_controller(made, kind):
    controller = made[kind]
    again = controller_from_dict(json.loads(json.dumps(controller_to_dict(controller))))
    assert type(again) is type(controller)
    assert controller_to_dict(again) == controller_to_dict(controller)
    reference, reading = series(controller, (40,), amplitude=0.5)
    np.testing.assert_array_equal(driven(again, reference, reading), driven(controller, reference, reading))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "general"])
def test_it_leaves_its_limit_at_once_when_the_error_turns(made, kind):
    controller, sign = made[kind], np.sign(made[kind].operating_output)
    state = controller.start()
    for _ in range(1000):
        command, state = controller.command(9.0 * sign, 0.0, state)
        assert command == controller.command_max
    command, _ = controller.command(0.95 * sign, 1.0 * sign, state)
    assert command < controller.command_max


def test_scaling_leaves_dynamics_that_are_fed_forward(made):
    # A law of the error beside a lag of the reference: with reference and reading equal only the lag answers.
    error = made.pi.law
    whole = Law(
        a=np.diag([1.0, 0.8]), b=np.array([error.b[0], [0.2, 0.0]]), c=np.array([1.0, 1.5]), d=error.d
    ).with_feedback(3.0)
    together = control.ss(whole.a, whole.b.sum(axis=1)[:, None], whole.c[None, :], [[whole.d.sum()]], H)
    z = np.exp(1j * np.linspace(0.1, 3.0, 9))
    np.testing.assert_allclose(together(z), 0.3 / (z - 0.8), rtol=1e-10)
    top, bottom = error.feedback
    np.testing.assert_allclose(whole.feedback[0], 3.0 * np.convolve(top, [1.0, -0.8]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(whole.feedback[1], np.convolve(bottom, [1.0, -0.8]), rtol=1e-9)


def test_a_document_of_an_unknown_kind_is_refused(made):
    with pytest.raises(ControlError, match="'fuzzy' is not known; there are linear, inverse, scheduled"):
        controller_from_dict({**controller_to_dict(made.pi), "kind": "fuzzy"})


@pytest.mark.parametrize(
    ("kind", "key"),
    [("pi", "law"), ("pi", "sample_time"), ("pi", "windup"), ("inverse", "curve"), ("scheduled", "points")],
)
def test_a_description_without_a_part_of_its_kind_is_refused(made, kind, key):
    data = controller_to_dict(getattr(made, kind))
    del data[key]
    with pytest.raises(ControlError, match=f"lacks {key}"):
        controller_from_dict(data)


@pytest.mark.parametrize("factor", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("kind", KINDS)
def test_a_loop_gain_of_nothing_is_refused(made, kind, factor):
    with pytest.raises(ControlError, match="must be finite and not 0"):
        made[kind].scaled(factor)


@pytest.mark.parametrize("kind", KINDS)
def test_a_copy_cannot_be_changed_either(made, kind):
    controller = pickle.loads(pickle.dumps(made[kind]))
    law = controller.local(controller.operating_input)
    for one in (controller, law, pickle.loads(pickle.dumps(law))):
        arrays = [value for value in vars(one).values() if isinstance(value, np.ndarray)]
        assert not any(array.flags.writeable for array in arrays)
