"""Effects of machines: each against its law, by another way of solving it."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import runs
from made_rigs import Pushed
from scipy.linalg import expm
from slopes import slope_errors

from deatwin.plant import (
    Backlash,
    Coupon,
    Creep,
    DeadZone,
    Diaphragm,
    DielectricAbsorption,
    DryFriction,
    Effect,
    Hysteresis,
    Plant,
    Rig,
    Sizes,
    effect_named,
)
from deatwin.plant.effects.relaxation import Relaxation, RelaxationSpectrum

STEP = 0.02
RNG = np.random.default_rng(4)
COMMANDS = np.repeat(RNG.uniform(-1.0, 1.0, 30), 5)
MACHINES = ("backlash", "coulomb_friction", "dead_zone", "relaxation")

pytestmark = pytest.mark.usefixtures("uncompiled")


def simulation(effect: Effect, commands: np.ndarray = COMMANDS, **rig: float) -> Any:
    return runs.simulation(Plant(rig=Pushed(**rig), effects=(effect,)), commands)


# The catalogue -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MACHINES)
def test_a_rig_of_ones_own_is_offered_it(name: str) -> None:
    effect = next(e for e in Pushed().effects() if e.name == name)
    assert Plant(rig=Pushed()).accepts(effect)
    assert {p.name for p in effect.describe()} == {f.name for f in fields(effect)}
    assert effect_named(name).name == name
    assert effect.wording.format(**{f.name: "x" for f in fields(effect)})


@pytest.mark.parametrize("rig", [Diaphragm(), Coupon()], ids=lambda rig: rig.kind)
def test_a_film_is_not_offered_it(rig: Rig) -> None:
    offered = {e.name: e for e in rig.effects()}
    assert not set(offered) & {"backlash", "dead_zone", "relaxation"}
    assert not isinstance(offered["coulomb_friction"], DryFriction)


@pytest.mark.parametrize(
    "effect",
    [
        effect_named("relaxation"),
        DeadZone(),
        Backlash(width=0.2),
        DryFriction(slip=1e-3, stiction=0.5, unevenness=0.2, speed=2e-3),
    ],
    ids=lambda e: e.name,
)
def test_slopes_are_those_of_differences(effect: Effect) -> None:
    errors = slope_errors(Plant(rig=Pushed(damping=0.2), effects=(effect,)), COMMANDS[:60], 1e-5)
    assert max(errors.values()) < 1e-4, errors


# Laws ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("relaxing", "times"),
    [
        (Relaxation(stiffness=12.0, time=0.3), (0.3,)),
        (RelaxationSpectrum(stiffness=12.0, time=0.3, decades=2.0), (0.03, 0.3, 3.0)),
    ],
)
def test_relaxation_is_the_generalised_maxwell_solid(relaxing: Effect, times: tuple[float, ...]) -> None:
    mass, damping, stiffness, count = 0.03, 0.05, 30.0, len(times)
    a = np.zeros((3 + count, 3 + count))  # displacement, velocity, command, dampers
    a[0, 1] = 1.0
    a[1, :3] = [-(stiffness + 12.0) / mass, -damping / mass, 6e-3 / mass]
    a[1, 3:] = 12.0 / count / mass
    for row, time in enumerate(times, start=3):
        a[row, 0], a[row, row] = 1 / time, -1 / time
    step, state, exact = expm(a * STEP), np.zeros(3 + count), []
    for command in COMMANDS:
        state[2] = command
        state = step @ state
        exact.append(state[0])
    found = simulation(relaxing, mass=mass).outputs[0][0]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8 * np.abs(exact).max())


def test_a_spectrum_has_the_sizes_of_the_rig() -> None:
    slow = Sizes(motion=3e-3, force=9e-3, period=0.6)  # ten times the diaphragm's motion and period
    wide = slow.of(Relaxation()).broadened()
    assert isinstance(wide, RelaxationSpectrum)
    assert (wide.described("time").upper, wide.described("stiffness").upper) == pytest.approx((600e3, 300.0))
    assert (wide.described("decades").lower, wide.described("decades").upper) == (0.5, 5.0)


@pytest.mark.parametrize("law", [Creep, DielectricAbsorption, Hysteresis, Relaxation])
def test_a_law_of_ones_own_is_not_replaced_by_the_spectrum_of_another(law: type[Effect]) -> None:
    wide = law().broadened()
    assert isinstance(wide, law) and wide.name == law.name
    assert wide.broadened() is None
    assert type("Own", (law,), {})().broadened() is None


def test_relaxation_starts_between_the_sample_and_the_record() -> None:
    found = effect_named("relaxation").starts(STEP * np.arange(1000), np.zeros(1000))
    times = [e.time for e in found]  # type: ignore[attr-defined]
    assert min(times) == pytest.approx(2 * STEP)
    assert max(times) == pytest.approx(20.0 / 3, rel=0.01)
    assert np.diff(np.log(times)).max() < np.log(10.0)


def test_a_dead_zone_takes_its_width_off() -> None:
    commands = np.linspace(-1.0, 1.0, 201)
    acting = simulation(DeadZone(width=0.3), commands).watched[0]["acting"]
    exact = np.sign(commands) * np.maximum(np.abs(commands) - 0.3, 0.0)
    # Half a width of the corner times ln 2 at most: 3.5 mV.
    assert np.abs(acting - exact).max() < 3.5e-3
    far = np.abs(np.abs(commands) - 0.3) > 0.05
    assert np.abs(acting - exact)[far].max() < 1e-6


def play(commands: np.ndarray, width: float) -> np.ndarray:
    """The discrete play operator, which is exact for commands that are held."""
    moved, found = 0.0, []
    for command in commands:
        moved = min(max(moved, command - width), command + width)
        found.append(moved)
    return np.array(found)


@pytest.mark.parametrize("width", [0.01, 0.2, 0.9])
def test_backlash_is_a_play(width: float) -> None:
    acting = simulation(Backlash(width=width)).watched[0]["acting"]
    np.testing.assert_allclose(acting, play(COMMANDS, width), rtol=0, atol=1e-3 * width)


def test_a_part_in_the_clearance_stays() -> None:
    commands = np.r_[np.full(5, 1.0), np.full(2000, 0.9)]
    acting = simulation(Backlash(width=0.1), commands).watched[0]["acting"]
    assert acting[-1] == pytest.approx(0.9, abs=1e-5)
    inside = simulation(Backlash(width=0.2), commands).watched[0]["acting"]
    assert inside[-1] == pytest.approx(0.8, abs=1e-3)


def steady_speed(push: float, friction: DryFriction, damping: float = 0.05) -> float:
    """Of a free mass with a damper under a constant force, N."""
    run = simulation(friction, np.full(400, push / 6e-3), stiffness=0.0, damping=damping)
    return float(run.watched[0]["velocity"][-1])


@pytest.mark.parametrize(("push", "level"), [(5e-3, 1.3), (-5e-3, 0.7)])
def test_uneven_friction_differs_by_direction(push: float, level: float) -> None:
    friction = DryFriction(force=1e-3, slip=5e-8, unevenness=0.3)
    assert steady_speed(push, friction) == pytest.approx((push - np.sign(push) * level * 1e-3) / 0.05, rel=1e-3)


@pytest.mark.parametrize(("push", "slides"), [(1.45e-3, False), (1.55e-3, True)])
def test_stiction_breaks_loose_at_its_own_level(push: float, slides: bool) -> None:
    friction = DryFriction(force=1e-3, slip=5e-8, stiction=0.5, speed=1e-3)
    exact = (push - 1e-3) / 0.05  # far above the Stribeck speed only the friction of motion is left
    assert steady_speed(push, friction) == pytest.approx(exact if slides else 0.0, abs=1e-7)


def law(friction: DryFriction) -> Callable[[float], float]:
    def against(v: float) -> float:
        level = 1 + friction.stiction * np.exp(-((v / friction.speed) ** 2))
        return friction.force * np.sign(v) * (1 + friction.unevenness * np.sign(v)) * level

    return against


@pytest.mark.parametrize("push", [4e-3, -3e-3])
def test_the_stribeck_curve_holds_in_between(push: float) -> None:
    # So much damping that the falling friction makes no stick-slip.
    friction, damping = DryFriction(force=1e-3, slip=5e-8, stiction=1.0, speed=2e-3, unevenness=-0.2), 1.0
    speed = steady_speed(push, friction, damping)
    assert push - damping * speed == pytest.approx(law(friction)(speed), rel=1e-3)
    assert 1.05 < (push - damping * speed) / (
        push - damping * steady_speed(push, replace(friction, stiction=0.0), damping)
    )
