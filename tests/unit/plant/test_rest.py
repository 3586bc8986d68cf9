"""Where experiments start: at rest, and where nothing decides about that at the guess; and what is said of a rig
whose equations cannot be used."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from made_rigs import Bare

from deatwin.plant import (
    Builder,
    Coupon,
    Diaphragm,
    Experiment,
    Hysteresis,
    Parameter,
    Plant,
    Recording,
    RigError,
    RunStatus,
    SimulationError,
    Sizes,
    actuation_curve,
)
from deatwin.plant.rest import rest_state
from deatwin.plant.small_signal import small_signals

STEP = 0.05
ONES = np.concatenate([np.zeros(2), np.ones(40)])
TIMES = STEP * np.arange(1, 41)
EXPERIMENT = Experiment(recordings=(Recording.from_arrays(ONES, np.zeros(ONES.size), STEP),))


pytestmark = pytest.mark.usefixtures("uncompiled")


def plant(equations: Callable[[Builder], Any], **values: float) -> Plant:
    """Of a rig with one parameter k = 1 whose `write` is given."""

    @dataclass(frozen=True, kw_only=True)
    class Toy(Bare):
        sample_time: float = STEP
        noise: float = 1e-3

        kind: ClassVar[str] = "toy"
        output_name: ClassVar[str] = "level"
        sizes: ClassVar[Sizes] = Sizes()

        @property
        def parameters(self) -> tuple[Parameter, ...]:
            return (Parameter(name="k", value=1.0, unit="1", lower=0.0, upper=10.0),)

        def write(self, build: Builder) -> Any:
            return equations(build)

    return Plant(rig=Toy(), values=values)


def motor(build: Builder, load: float = 0.0) -> Any:
    """Turned by the command against a load, with a time constant of one second; k is where it stands at first."""
    angle, speed = build.state("angle", scale=1.0), build.state("speed", scale=1.0)
    build.guess(angle, build.parameter("k"))
    build.rate(angle, speed)
    build.rate(speed, build.command - load - speed)
    return angle


def test_an_angle_starts_at_its_guess() -> None:
    turning = plant(motor, k=3.0)
    simulation = turning.simulate(EXPERIMENT)
    np.testing.assert_allclose(simulation.outputs[0][0][2:], 3.0 + TIMES - 1 + np.exp(-TIMES), rtol=0, atol=1e-9)
    run = turning.simulator.run_with_sensitivities(
        ONES, start=0.0, sample_time=STEP, rest_command=0.0, values=turning.free_values
    )
    assert run.sensitivities is not None
    np.testing.assert_allclose(run.sensitivities, 1.0, atol=1e-12)  # of the angle by where it stood at first


def test_what_can_rest_does_beside_what_cannot() -> None:
    loaded = plant(lambda build: motor(build, load=2.0))
    rest = rest_state(loaded.equations, 0.0, loaded.free_values)
    np.testing.assert_allclose(rest.x, [1.0, -2.0], atol=1e-12)
    np.testing.assert_allclose(rest.x_p.ravel(), [1.0, 0.0], atol=1e-12)


def mass(build: Builder) -> Any:
    place, speed = build.state("place", scale=1.0), build.state("speed", scale=1.0)
    build.rate(place, speed)
    build.rate(speed, build.command)
    return place


def tank(build: Builder) -> Any:
    level = build.state("level", scale=1.0)
    build.guess(level, 2.0)
    build.rate(level, build.command + 0.5)
    return level


@pytest.mark.parametrize(("equations", "expected"), [(mass, TIMES**2 / 2), (tank, 2.0 + 2 * STEP * 0.5 + 1.5 * TIMES)])
def test_a_mass_on_no_spring_and_a_tank_that_a_pump_fills_start_at_their_guess(
    equations: Callable[[Builder], Any], expected: np.ndarray
) -> None:
    readings = plant(equations).simulate(EXPERIMENT).outputs[0][0]
    np.testing.assert_allclose(readings[2:], expected, rtol=0, atol=1e-9)


def two_tanks(build: Builder, pump: float = 0.0) -> Any:
    """Joined by a pipe; nothing leaves them."""
    one, other = build.state("one", scale=1.0), build.state("other", scale=1.0)
    build.guess(one, 1.0)
    build.guess(other, 3.0)
    build.rate(one, build.command + pump - (one - other))
    build.rate(other, one - other)
    return one


def test_what_two_tanks_hold_together_stays_as_guessed() -> None:
    joined = plant(two_tanks)
    rest = rest_state(joined.equations, 0.0, joined.free_values)
    np.testing.assert_allclose(rest.x, [2.0, 2.0], atol=1e-12)


def springless(build: Builder) -> Any:
    """A spring of no stiffness, as its parameter has it, and a weight."""
    place, speed = build.state("place", scale=1.0), build.state("speed", scale=1.0)
    build.rate(place, speed)
    build.rate(speed, 1.0 - (build.parameter("k") - 1) * place - speed)
    return place


@pytest.mark.parametrize(
    ("equations", "said"),
    [
        (springless, r'state place has no equilibrium at the start: let it start .*build.state\("place", scale='),
        (lambda build: two_tanks(build, pump=1.0), "states one, other have no equilibrium at the start: let one start"),
    ],
)
def test_where_nothing_decides_the_state_is_named_with_the_remedy(
    equations: Callable[[Builder], Any], said: str
) -> None:
    simulation = plant(equations).simulate(EXPERIMENT)
    assert simulation.status is RunStatus.NO_REST
    with pytest.raises(SimulationError, match=said):
        simulation.require()
    with pytest.raises(SimulationError, match=said):
        actuation_curve(plant(equations), np.array([0.0, 1.0]))


def rootless(build: Builder, rest: Callable[[Any, Any], Any]) -> Any:
    """A balance of a real coordinate and a state that no real values meet, beside one that has a root."""
    state = build.state("state", scale=1.0, start=build.parameter("k"))
    root, none = build.coordinate("root", scale=1.0), build.coordinate("none", scale=1.0)
    build.balance(root - state)
    build.balance(rest(none, state))
    build.rate(state, build.command - state + none)
    return state


@pytest.mark.parametrize(
    "rest",
    [
        lambda z, x: z**2 + x**2 + 1,
        lambda z, x: ca.exp(z) + x**2 + 1,
        lambda z, x: z**4 - 0.1 * z + 1,
        lambda z, x: ca.cosh(z - 0.3) + x**2,
    ],
)
@pytest.mark.parametrize("command", [0.0, 0.5])
def test_an_equation_without_a_real_root_is_named(rest: Callable[[Any, Any], Any], command: float) -> None:
    made = plant(partial(rootless, rest=rest))
    found = rest_state(made.equations, command, made.free_values)
    assert not found.found
    assert "the balance for coordinate none was zero nowhere" in found.fault and "film" not in found.fault


def test_a_rate_without_a_real_root_is_named_with_both_remedies() -> None:
    made = plant(partial(first_order, rate=lambda level: -1 - (level - 0.4) ** 2))
    fault = rest_state(made.equations, 0.0, made.free_values).fault
    assert "the rate of state level was zero nowhere" in fault and "start=" in fault


def test_a_motor_is_linearised_about_its_steady_motion() -> None:
    for found in small_signals(plant(motor), [0.0, 2.0]):
        assert found is not None
        fall = np.exp(-STEP)
        np.testing.assert_allclose(found.a, [[1.0, 1 - fall], [0.0, fall]], atol=1e-9)
    np.testing.assert_allclose(actuation_curve(plant(motor), np.array([0.0, 2.0])).unknowns["speed"], [0.0, 2.0])


def first_order(build: Builder, rate: Callable[[Any], Any]) -> Any:
    level = build.state("level", scale=1.0)
    build.rate(level, rate(level))
    return level


@pytest.mark.parametrize(
    ("rate", "said"),
    [
        (lambda x: 1 - 1 / x, r"the rate of state level has no finite value at the initial guess \(level = 0\)"),
        (lambda x: ca.log(x - 1), "the rate of state level has no finite value at the initial guess"),
        (lambda x: -ca.sqrt(x), "the rate of state level has no finite slope at the initial guess"),
    ],
)
def test_an_equation_without_a_value_at_the_guess_is_named(rate: Callable[[Any], Any], said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        plant(lambda build: first_order(build, rate)).simulate(EXPERIMENT).require()


def test_a_reading_without_a_value_at_rest_is_named() -> None:
    with pytest.raises(SimulationError, match="the reading has no finite value at rest"):
        plant(lambda build: ca.log(first_order(build, lambda x: -x))).simulate(EXPERIMENT).require()


@pytest.mark.parametrize(
    ("reading", "rate", "said"),
    [
        (lambda x: x, lambda x, u: u + ca.sqrt(1.0 - x), r"the rate of state level has no finite .* near level = "),
        (lambda x: ca.log(1.0 - x), lambda x, u: u + 0.1, r"the reading has no finite value near level = "),
    ],
)
def test_an_equation_that_loses_its_value_on_the_way_is_named(
    reading: Callable[[Any], Any], rate: Callable[[Any, Any], Any], said: str
) -> None:
    def equations(build: Builder) -> Any:
        level = build.state("level", scale=1.0)
        build.rate(level, build.command * rate(level, build.command))
        return reading(level)

    driven = Recording.from_arrays(np.ones(40), np.zeros(40), STEP)
    model = plant(equations)
    with pytest.raises(SimulationError, match=said):
        model.simulate(Experiment(recordings=(driven,))).require()
    stopped = model.simulator.run_with_sensitivities(
        np.ones(40), start=0.0, sample_time=STEP, rest_command=0.0, values=model.free_values
    )
    assert re.search(said, stopped.advice)


def test_of_a_rig_that_runs_away_no_film_is_spoken() -> None:
    def escapes(build: Builder) -> Any:
        level = build.state("level", scale=1.0)
        build.rate(level, build.command + 30.0 * level**2)
        return level

    with pytest.raises(SimulationError, match="runs away from it") as told:
        plant(escapes).simulate(EXPERIMENT).require()
    assert "film" not in str(told.value)


def unbalanced(build: Builder) -> Any:
    build.coordinate("pressure", scale=1.0)
    build.balance(build.command)
    return build.command


def massive(build: Builder) -> Any:
    level = build.state("level", scale=1.0)
    build.rate(level, -level, mass=1 + level)
    return level


def named_twice(build: Builder) -> Any:
    build.state("level", scale=1.0)
    return build.state("level", scale=1.0)


def rated_twice(build: Builder) -> Any:
    level = first_order(build, lambda x: -x)
    build.rate(level, -2 * level)
    return level


def guessed_from_itself(build: Builder) -> Any:
    level = first_order(build, lambda x: -x)
    build.guess(level, level)
    return level


@pytest.mark.parametrize(
    ("equations", "said"),
    [
        (lambda b: first_order(b, lambda x: ca.vertcat(x, x)), "the rate of state level has 2 rows and 1 columns"),
        (lambda b: first_order(b, lambda x: None), "the rate of state level is of the type NoneType"),
        (lambda b: first_order(b, lambda x: ca.MX.sym("q")), "the rate of state level is of the type casadi.MX"),
        (lambda b: first_order(b, lambda x: np.nan), r"the rate of state level contains .* \(NaN\)"),
        (lambda b: first_order(b, lambda x: -x * float(ca.DM(x))), r"the rate of state level contains .* \(NaN\)"),
        (lambda b: first_order(b, lambda x: -math.sin(x)), "TypeError: an expression has no value yet.*test_rest.py"),
        (lambda b: first_order(b, lambda x: -x if float(x) > 0 else x), "TypeError: an expression has no value yet"),
        (lambda b: first_order(b, lambda x: -max(x, 0)), "truth value .*use casadi.if_else.*test_rest.py, line"),
        (lambda b: first_order(b, lambda x: np.linalg.inv(np.array([[x]]))), "UFuncTypeError.*test_rest.py, line"),
        (lambda b: first_order(b, lambda x: ca.sin(x, x)), r"NotImplementedError.*'sin'.*You have: '\(SX,SX\)'"),
        (
            lambda b: first_order(b, lambda x: b.at_rest("first", None)),
            "the value of first at rest is of the type None",
        ),
        (
            lambda b: first_order(b, lambda x: b.at_rest("first", b.command)),
            "the value of first at rest depends on comm",
        ),
        (lambda b: b.state("level", scale=1.0, start=ca.SX.sym("q")), "no rate is given for state level"),
        (lambda b: b.channel("temperature", b.command), "without the channel temperature is the expression command"),
        (lambda b: b.constant("area", b.command), "the constant area is the expression command; it must be a number"),
        (lambda b: b.divide(None), "the first part of a sample is of the type NoneType"),
        (lambda b: first_order(b, lambda x: -x * ca.SX.sym("q")), "the rate of state level depends on q"),
        (lambda b: first_order(b, lambda x: -x) * ca.SX.sym("q"), "the reading depends on q"),
        (lambda b: first_order(b, lambda x: -x) and None, "what write returns, the reading, is of the type NoneType"),
        (lambda b: b.rate(2 * b.state("level", scale=1.0), 0.0), r"a rate is given for \(2.\*level\)"),
        (lambda b: b.state("level", scale=0.0), "the scale of state level is 0.0; it must be a finite number above 0"),
        (lambda b: b.constant("area", np.nan), r"the constant area is not a number \(NaN\)"),
        (lambda b: ca.SX(2, 1) @ ca.SX(3, 1), "the rig toy raised RuntimeError: .*2x1 .*3x1.*test_rest.py, line"),
        (lambda b: 1 / 0, "the rig toy raised ZeroDivisionError: division by zero .*test_rest.py, line"),
        (unbalanced, "no balance depends on coordinate pressure"),
        (massive, "the mass of state level depends on level, which it must not: parameters and constants"),
        (rated_twice, "state level has two rates; give their sum in one build.rate"),
        (named_twice, "two unknowns are called level"),
        (guessed_from_itself, "the guess of level depends on level"),
    ],
)
def test_a_fault_in_a_rigs_equations_is_one_line_that_names_the_equation(
    equations: Callable[[Builder], Any], said: str
) -> None:
    with pytest.raises(RigError, match=said) as raised:
        _ = plant(equations).equations
    assert "\n" not in str(raised.value)


def test_an_effect_whose_code_fails_is_not_taken_for_one_that_does_not_fit() -> None:
    class Broken(Hysteresis):
        def rewrite(self, signal: Any, build: Builder) -> Any:
            raise ValueError("a slip of the pen")

    with pytest.raises(RigError, match="raised ValueError: a slip of the pen"):
        Plant(rig=Diaphragm()).accepts(Broken())


def test_a_rig_without_unknowns_names_no_place_of_its_fault(experiment) -> None:
    """The force of a strip follows its stretch at once, and a stretch of 0 has no volume."""
    found = Plant(rig=Coupon()).simulate(experiment(np.array([1.0, 0.0]), sample_time=Coupon().sample_time))
    assert "no finite value, as a quotient by zero" in found.advice
