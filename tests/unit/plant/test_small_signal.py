"""One sample about rest against exact discretisation, differences of the step, and the actuation curve."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from slopes import differences

from deatwin.plant import (
    Creep,
    DataError,
    Delay,
    Diaphragm,
    ElectrodeRC,
    PermittivityDrift,
    Plant,
    SensorLag,
    Stack,
    actuation_curve,
)
from deatwin.plant.integrator.collocation import step_functions
from deatwin.plant.rest import rest_state
from deatwin.plant.small_signal import small_signals

H = 0.02


@pytest.mark.parametrize(("stiffness", "steps"), [(400.0, 1), (400.0 * 10.0**2, 8)])
def test_a_linear_rig_is_discretised_exactly(oscillator, stiffness: float, steps: int):
    """The fast mode takes four radians a sample, half of one in each of eight steps."""
    plant = Plant(rig=oscillator(), values={"stiffness": stiffness}, steps=steps)
    (small,) = small_signals(plant, [3.0])
    continuous = np.array([[0.0, 1.0, 0.0], [-stiffness, -2.0, 1.0], [0.0, 0.0, 0.0]])
    exact = expm(H * continuous)
    scale = plant.equations.scale
    # Order 9 of the scheme: (omega h)^10/10! = 3e-11 of the motion over a sample.
    np.testing.assert_allclose(small.a * scale[:, None] / scale, exact[:2, :2], atol=1e-8 * steps * stiffness / 400.0)
    np.testing.assert_allclose(small.b[:, 0] * scale, exact[:2, 2], rtol=1e-8)
    np.testing.assert_allclose(small.c / scale, exact[0, :2], atol=1e-9)
    np.testing.assert_allclose(small.d, exact[0, 2:], rtol=1e-8)
    assert small.reading == pytest.approx(3.0 / stiffness, rel=1e-12)


def test_derivatives_are_those_of_the_step_that_simulates():
    plant = Plant(rig=Diaphragm()).with_effects(Creep(time=2.0), Delay(time=0.03), ElectrodeRC(), SensorLag())
    equations, values, command = plant.equations, plant.free_values, 2.5
    (small,) = small_signals(plant, [command])
    held = rest_state(equations, 0.0, values).d
    rest = rest_state(equations, command, values)
    step, scale = step_functions(equations).plain, equations.scale[: rest.x.size]
    inputs = equations.held_inputs(command)

    def after(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        x_end, _, y, *_ = step(x, rest.z, held, u, 0.0, H, values, equations.constants)
        return np.append(np.asarray(x_end).ravel() / scale, float(y))

    # With what is held at 0 V the charge at rest is another: the plant is walked there.
    x = rest.x
    for _ in range(2000):
        x = after(x, inputs)[:-1] * scale
    size = 1e-5
    by_state = differences(lambda moved: after(moved * scale, inputs), x / scale, size)
    by_input = differences(lambda moved: after(x, moved), inputs, size)[:, : 1 + equations.history]
    whole = np.vstack([np.column_stack([small.a, small.b]), np.concatenate([small.c, small.d])])
    found = np.hstack([by_state, by_input])
    # Newton's rounding by the size of the difference, and its square by the curvature.
    np.testing.assert_allclose(whole[:-1], found[:-1], atol=1e-6)
    np.testing.assert_allclose(whole[-1], found[-1], atol=1e-9)


def test_a_dead_time_of_whole_samples_only_moves_the_columns():
    bare = Plant(rig=Diaphragm())
    (now,), (late,) = small_signals(bare, [2.0]), small_signals(bare.with_effects(Delay(time=2 * H)), [2.0])
    assert late.b.shape[1] == late.d.size > 3
    # No part of a sample takes less than 1e-9 of it.
    np.testing.assert_allclose(late.b[:, 2], now.b[:, 0], rtol=1e-8)
    np.testing.assert_allclose(late.b[:, [0, 1, 3]], 0.0, atol=1e-8 * np.abs(now.b).max())
    np.testing.assert_allclose(late.d[2], now.d[0], rtol=1e-8)


@pytest.mark.parametrize("time", [0.0, 300.0])
def test_beside_a_dead_time_the_clock_stands_still_as_without_one(time):
    drifting = Plant(rig=Diaphragm()).with_effects(PermittivityDrift(relative_change=-0.3, time=100.0))
    late = drifting.with_effects(Delay(time=2 * H))
    (without,), (with_it,) = small_signals(drifting, [2.5], time=time), small_signals(late, [2.5], time=time)
    # Within a sample the clock may be off by a sample of 20 ms, of 100 s.
    np.testing.assert_allclose(with_it.b[:, 2], without.b[:, 0], rtol=3e-4)
    np.testing.assert_allclose(with_it.reading, without.reading, rtol=1e-9)
    (half,) = small_signals(drifting.with_effects(Delay(time=1.5 * H)), [2.5], time=time)
    # All of the command acts, sooner or later: in the end as without a dead time.
    np.testing.assert_allclose(_settled(half), _settled(without), rtol=3e-4)


def _settled(small):
    """Change of the reading by a lasting change of the command."""
    moved = np.linalg.solve(np.eye(len(small.a)) - small.a, small.b.sum(axis=1))
    return small.c @ moved + small.d.sum()


def test_what_drifts_by_the_clock_stands_still():
    drifting = Plant(rig=Diaphragm()).with_effects(PermittivityDrift(relative_change=-0.1, time=300.0))
    permittivity = drifting.parameters["permittivity"].value
    (late,) = small_signals(drifting, [2.5], time=300.0)
    still = replace(drifting, effects=()).with_values({"permittivity": permittivity * (1 - 0.1 * (1 - np.exp(-1)))})
    (same,) = small_signals(still, [2.5])
    np.testing.assert_allclose(late.a, same.a, atol=1e-9)
    np.testing.assert_allclose(late.b, same.b, rtol=1e-8)
    assert late.reading == pytest.approx(same.reading, rel=1e-9)


def test_there_is_none_beyond_pull_in_and_where_the_film_is_slack():
    stack = Plant(rig=Stack())
    pull_in = float(actuation_curve(stack, np.linspace(0.0, 3.0, 31)).commands[-1])
    found = small_signals(stack, [3.0, 1.001 * pull_in, 0.999 * pull_in, 0.0])
    assert [small is not None for small in found] == [False, False, True, True]
    film = Plant(rig=Diaphragm())
    slack = actuation_curve(film, np.linspace(0.0, 5.0, 101)).slack_command
    assert [small is not None for small in small_signals(film, [0.999 * slack, 1.001 * slack])] == [True, False]


def test_readings_are_those_of_the_actuation_curve():
    plant, commands = Plant(rig=Diaphragm()), np.array([3.5, 1.1, 2.0])
    expected = actuation_curve(plant, np.sort(commands))
    readings = [small.reading for small in small_signals(plant, commands)]
    np.testing.assert_allclose(np.sort(readings), expected.readings, rtol=1e-9)


def test_commands_must_be_finite(base):
    with pytest.raises(DataError, match="finite"):
        small_signals(base, [np.nan])
