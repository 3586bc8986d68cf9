"""Designs at several operating points as one controller."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from deatwin.control import ControlError, LinearStatus, lambda_tuning
from deatwin.control.design.lambda_tuning import lambda_tuning_pid
from deatwin.control.design.loop_shaping import loop_shaping_pid
from deatwin.control.design.lqg import lqg
from deatwin.control.design.scheduling import scheduled

H = 0.02
LIMITS = (1.0, 4.0)
POINTS = (1.1, 1.75, 2.4, 3.1, 3.75)
PI = partial(lambda_tuning, closed_loop_time=0.4)


@pytest.fixture
def models(sampled):
    """A static gain that grows with the command, and lags that fall."""
    made = [sampled(0.5 * u, [1.2 / u, 0.3 / u], delay=1, point=u) for u in POINTS]
    return [replace(m, operating_output=0.25 * m.operating_input**2) for m in made]


@pytest.mark.parametrize("design", [PI, partial(lambda_tuning_pid, closed_loop_time=0.4), loop_shaping_pid])
def test_at_each_point_it_is_the_design_there_and_keeps_its_closed_loop(models, around, design):
    controller = scheduled(models, design, command_limits=LIMITS)
    for model in models:
        alone = design(model, command_limits=LIMITS)
        found = controller.local(model.operating_input)
        for polynomial, expected in zip(found.feedback, alone.law.feedback, strict=True):
            np.testing.assert_allclose(polynomial, expected, rtol=1e-9, atol=1e-12)
        poles = [np.poly(np.linalg.eigvals(around(model, c).A)) for c in (controller, alone)]
        np.testing.assert_allclose(poles[0], poles[1], atol=1e-9)
        assert np.abs(np.linalg.eigvals(around(model, controller).A)).max() < 1.0


def test_between_two_points_gains_lie_between(models):
    controller = scheduled(models, PI, command_limits=LIMITS)
    ends = [controller.local(u).feedback[0] for u in (1.75, 2.4)]
    np.testing.assert_allclose(controller.local(2.075).feedback[0], np.mean(ends, axis=0), rtol=1e-12)


def test_the_order_of_the_models_does_not_matter(models):
    first, second = (scheduled(order, PI, command_limits=LIMITS) for order in (models, models[::-1]))
    np.testing.assert_array_equal(first.points, second.points)
    assert first.operating_input == second.operating_input == 2.4
    assert scheduled(models, PI, command_limits=LIMITS, operating_input=3.1).operating_output == 0.25 * 3.1**2


def test_it_follows_a_curved_actuator_over_its_range(models):
    # The static curve y = u^2/4 behind a lag of 0.3 s and a sample: steps from one end to the other.
    controller = scheduled(models, PI, command_limits=LIMITS)
    pole, state, reading, readings = np.exp(-H / 0.3), controller.start(), 0.25 * 2.4**2, []
    levels = np.repeat([0.4, 3.2, 1.0], 600)
    command = 2.4
    for asked in levels:
        reading = pole * reading + (1 - pole) * 0.25 * command**2
        command, state = controller.command(asked, reading, state)
        readings.append(reading)
    for end, level in ((599, 0.4), (1199, 3.2), (1799, 1.0)):
        assert readings[end] == pytest.approx(level, abs=1e-3)


def test_a_point_without_a_design_is_named_with_the_reason(models):
    broken = [*models[:3], replace(models[3], status=LinearStatus.UNSTABLE), models[4]]
    with pytest.raises(ControlError, match=r"no design at 3\.1 V: the operating point of the model is unstable"):
        scheduled(broken, PI, command_limits=LIMITS)
    with pytest.raises(ControlError, match=r"no design at 1\.1 V: a closed-loop time of 0\.001 s"):
        scheduled(models, partial(lambda_tuning, closed_loop_time=0.001), command_limits=LIMITS)


def test_points_may_lie_on_the_limits(models):
    controller = scheduled(models, PI, command_limits=(1.1, 3.75))
    assert (controller.command_min, controller.command_max) == (1.1, 3.75)
    np.testing.assert_allclose(controller.points, POINTS)


@pytest.mark.parametrize(
    ("change", "given", "message"),
    [
        (lambda m: m[:1], {}, "two or more operating points"),
        (lambda m: [m[0], replace(m[1], sample_time=0.05)], {}, "one sample time"),
        (lambda m: [m[0], replace(m[1], numerator=-m[1].numerator)], {}, "changes its sign between 1.1 and 1.75 V"),
        (lambda m: m, {"operating_input": 2.0}, r"there are models at 1.1, 1.75"),
        (lambda m: m, {"design": partial(lqg, closed_loop_time=0.4)}, "schedule PI or PID laws"),
    ],
)
def test_points_and_laws_that_do_not_fit_are_refused(models, change, given, message):
    with pytest.raises(ControlError, match=message):
        scheduled(change(models), **{"design": PI, "command_limits": LIMITS, **given})
