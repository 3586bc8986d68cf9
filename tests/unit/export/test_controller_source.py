"""Controllers as C, against `Controller.command`."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_controllers import COMMON, inverse_of, made_controllers

from deatwin.control import Law, LinearController, StaticCurve
from deatwin.control.controllers.base import Controller
from deatwin.control.errors import ControlError
from deatwin.control.export.controller import controller_source

ROUNDING = 1e-12
"""Of commands of some volts; the inverse of the curve has a slope of up to 4 V a unit, which enlarges it."""


def linear() -> LinearController:
    """Three states, two degrees of freedom."""
    rng = np.random.default_rng(4)
    a = np.diag([1.0, 0.8, -0.3]) + np.triu(0.1 * rng.normal(size=(3, 3)), 1)
    law = Law(a=a, b=rng.normal(size=(3, 2)), c=np.array([0.4, 0.2, -0.1]), d=rng.normal(size=2))
    return LinearController(name="general", law=law, windup=np.array([0.5, 0.0, 0.0]), **COMMON)


def without_states() -> LinearController:
    law = Law(a=np.empty((0, 0)), b=np.empty((0, 2)), c=np.empty(0), d=np.array([1.0, -0.8]))
    return LinearController(name="P", law=law, windup=np.empty(0), **COMMON)


KINDS = {
    "linear": linear,
    "static": without_states,
    "rising": lambda: inverse_of(1.0, points=12, wave=0.02),
    "falling": lambda: inverse_of(-1.0, points=12, wave=0.02),
    "scheduled": lambda: made_controllers()["scheduled"],
}


def commanded(controller: Controller, series: np.ndarray) -> np.ndarray:
    state, found = controller.start(), []
    for reference, reading in series:
        command, state = controller.command(reference, reading, state)
        found.append(float(command))
    return np.array(found)


def some_series(controller: Controller, size: float) -> np.ndarray:
    """Reference and reading that wander about the operating output, at times far enough to reach both limits."""
    rng = np.random.default_rng(7)
    wander = np.repeat(rng.normal(size=(40, 2)), 10, axis=0) + 0.2 * rng.normal(size=(400, 2))
    return controller.operating_output + size * wander


@pytest.mark.parametrize("kind", KINDS)
def test_the_source_commands_what_the_controller_does(kind: str, run_c: Any) -> None:
    controller = KINDS[kind]()
    series = some_series(controller, 1.0)
    expected = commanded(controller, series)
    assert expected.min() == controller.command_min and expected.max() == controller.command_max
    assert np.count_nonzero((expected > 1.0) & (expected < 4.0)) > 100  # between the limits the law is seen
    found, status = run_c(controller_source(controller), series)
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=ROUNDING)
    assert not status.any()


@pytest.mark.parametrize("kind", KINDS)
def test_single_precision_loses_digits_only(kind: str, run_c: Any) -> None:
    controller = KINDS[kind]()
    series = some_series(controller, 0.2)[:100]
    flags = ("-std=c99", "-Wdouble-promotion", "-Werror", "-DCONTROLLER_REAL=float")
    found, _ = run_c(controller_source(controller), series, *flags)
    # A float rounds at 1e-7; integrators add a hundred of these, gains stay below 4.
    np.testing.assert_allclose(found[:, 0], commanded(controller, series), rtol=0, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_reading_that_is_not_finite_leaves_the_command(kind: str, run_c: Any) -> None:
    controller = KINDS[kind]()
    series = some_series(controller, 0.2)[:50]
    broken = np.insert(series, 20, [[1.0, np.nan], [1.0, np.inf], [np.nan, 1.0]], axis=0)
    found, status = run_c(controller_source(controller), broken)
    np.testing.assert_array_equal(np.flatnonzero(status), [20, 21, 22])
    np.testing.assert_array_equal(found[20:23, 0], found[19, 0])
    expected = commanded(controller, series)  # the state was left alone too
    np.testing.assert_allclose(np.delete(found[:, 0], [20, 21, 22]), expected, rtol=0, atol=ROUNDING)


def test_a_curve_with_a_horizontal_tangent_is_inverted_as_well_as_it_can_be(run_c: Any) -> None:
    points = np.linspace(0.0, 4.0, 9)
    whole = inverse_of(1.0)
    curve = StaticCurve(inputs=points, outputs=points**4 / 256.0)
    flat = replace(whole, curve=curve, command_min=-1.0)
    series = whole.operating_output + np.column_stack([np.linspace(-1.0, 2.0, 200), np.zeros(200)])
    found, _ = run_c(controller_source(flat), series)
    np.testing.assert_allclose(curve.output(found[:, 0]), curve.output(commanded(flat, series)), rtol=0, atol=1e-13)


def test_a_controller_of_a_kind_of_its_own_is_refused() -> None:
    class Own(LinearController):
        pass

    class Other(Controller):
        kind = "other"
        states = 0
        start = command = local = scaled = details = from_details = lambda self: None

    assert controller_source(Own(**vars(linear()))).name == "controller"
    with pytest.raises(ControlError, match="'other' has no C source; linear, inverse and scheduled ones have"):
        controller_source(Other(name="other", **COMMON))
