"""The rigs of docs/how-to/machines.md, diagnosed on recordings that other equations and another integrator made.

One is diagnosed in the gate; all four, and each without anything concealed, have the mark `study`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.ident.mismatch import Diagnosis, diagnose
from deatwin.plant import Experiment, Recording
from deatwin.plant.integrator.compiled import compiler

PAGE = Path(__file__).parents[3] / "docs/how-to/machines.md"

pytestmark = pytest.mark.skipif(compiler() is None, reason="many simulations: without a C compiler they take long")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A machine as it really is, and what is to be found of what is concealed in it."""

    rates: Callable[[Any, float, bool], list[float]]  # of state, command, and whether something is concealed
    reading: Callable[[Any, float], float]
    rest: tuple[float, ...]
    commands: Callable[[np.random.Generator], np.ndarray]
    effect: str
    found: dict[str, float]


def steps(rng: np.random.Generator, number: int, low: float, high: float, hold: int) -> np.ndarray:
    return np.repeat(rng.uniform(low, high, number // hold), hold)


def motor_rates(x: Any, u: float, concealed: bool, stiction: float = 0.4, unevenness: float = 0.15) -> list[float]:
    ohms, constant, inertia, drag = 2.0, 0.048, 1.1e-4, 1.2e-5
    side = np.tanh(x[0] / 0.05)
    friction = 6e-3 * side * (1 + unevenness * side) * (1 + stiction * np.exp(-((x[0] / 4.0) ** 2)))
    torque = constant * (u - constant * x[0]) / ohms
    return [(torque - drag * x[0] - friction * concealed) / inertia]


def cylinder_rates(x: Any, u: float, concealed: bool) -> list[float]:
    """Of position, velocity and pressure, bar."""
    opening = np.sign(u) * max(abs(u) - 0.3, 0.0) if concealed else u
    inflow = 3.3e-5 * opening - 5e-10 * 1e5 * x[2] - 5e-4 * x[1]
    return [x[1], (5e-4 * 1e5 * x[2] - 2200.0 * x[0] - 60.0 * x[1]) / 2.0, inflow / 1.1e-10 / 1e5]


def room_rates(x: Any, u: float, concealed: bool) -> list[float]:
    """Of air, walls and problem."""
    into_walls, into_bench = 140.0 * (x[0] - x[1]), 120.0 * (x[0] - x[2]) * concealed
    return [
        (u - into_walls - 35.0 * x[0] - into_bench) / 1.2e4,
        (into_walls - 90.0 * x[1]) / 4e5,
        into_bench / (120.0 * 360.0),
    ]


def battery_rates(x: Any, u: float, concealed: bool) -> list[float]:
    """Of charge, two overvoltages and warmth."""
    ohmic = 0.032 * (1 - 0.012 * x[3]) * u
    heating = u * (ohmic + x[1] + x[2]) - 0.12 * x[3]
    return [-u / 9000.0, (0.018 * u - x[1]) / 9.0, (0.015 * u * concealed - x[2]) / 120.0, heating / 40.0]


CASES = {
    "motor": Case(
        rates=motor_rates,
        reading=lambda x, u: x[0],
        rest=(0.0,),
        commands=lambda rng: steps(rng, 1200, -3.0, 3.0, 20) + steps(rng, 1200, -0.5, 0.5, 4),
        effect="coulomb_friction",
        found={"force": 6e-3, "stiction": 0.4, "unevenness": 0.15},
    ),
    "cylinder": Case(
        rates=cylinder_rates,
        reading=lambda x, u: x[0],
        rest=(0.0, 0.0, 0.0),
        commands=lambda rng: steps(rng, 1200, -2.5, 2.5, 25),
        effect="dead_zone",
        found={"width": 0.3},
    ),
    "room": Case(
        rates=room_rates,
        reading=lambda x, u: x[0],
        rest=(0.0, 0.0, 0.0),
        commands=lambda rng: steps(rng, 1200, 0.0, 2000.0, 12),
        effect="relaxation",
        found={"stiffness": 120.0, "time": 360.0},
    ),
    # Two resistors with capacitors in series are one with a slow branch beside it, of the time at which the sum of both
    # impedances is zero: (R1 T2 + R2 T1)/(R1 + R2).
    "battery": Case(
        rates=battery_rates,
        reading=lambda x, u: 3.28 + 0.85 * x[0] - 0.032 * (1 - 0.012 * x[3]) * u - x[1] - x[2],
        rest=(1.0, 0.0, 0.0, 0.0),
        commands=lambda rng: steps(rng, 1500, -2.5, 4.0, 15),
        effect="relaxation",
        found={"time": (18.0 * 120.0 + 15.0 * 9.0) / 33.0},
    ),
}


def diagnosis(name: str, concealed: bool, seed: int) -> Diagnosis:
    code = re.search(rf'^```python title="{name}\.py"\n(.*?)^```', PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert code is not None
    module = ModuleType(name)
    exec(compile(code[1], f"{name}.py", "exec"), vars(module))
    plant, case, rng = module.plant(), CASES[name], np.random.default_rng(seed)
    commands, state, readings = case.commands(rng), np.array(case.rest), []
    for command in commands:
        run = solve_ivp(
            lambda t, x, u=command: case.rates(x, u, concealed),
            (0.0, plant.rig.sample_time),
            state,
            method="LSODA",
            rtol=1e-8,
            atol=1e-10,
        )
        state = run.y[:, -1]
        readings.append(case.reading(state, command))
    noisy = np.array(readings) + plant.rig.noise * rng.standard_normal(commands.size)
    record = Recording.from_arrays(commands, noisy, plant.rig.sample_time)
    return diagnose(plant, Experiment(recordings=(record,)))


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n == "room" else [pytest.mark.study]) for n in CASES])
def test_what_is_concealed_is_named(name: str) -> None:
    found, case = diagnosis(name, True, 1), CASES[name]
    assert found.verdict.value == "named"
    assert [cause.effect for cause in found.causes] == [case.effect]
    for parameter, value in case.found.items():
        interval = found.causes[0].parameters[parameter]
        assert interval.value == pytest.approx(value, rel=0.1), parameter


@pytest.mark.study
@pytest.mark.parametrize("seed", [1, 2])
def test_plain_friction_is_found_plain(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = partial(motor_rates, stiction=0.0, unevenness=0.0)
    monkeypatch.setitem(CASES, "motor", replace(CASES["motor"], rates=plain))
    (cause,) = diagnosis("motor", True, seed).causes
    assert cause.effect == "coulomb_friction"
    assert cause.parameters["force"].value == pytest.approx(6e-3, rel=0.02)
    for shape in ("stiction", "unevenness"):
        assert cause.parameters[shape].value == pytest.approx(0.0, abs=0.05)


@pytest.mark.study
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("name", CASES)
def test_nothing_is_named_where_nothing_is_concealed(name: str, seed: int) -> None:
    assert not diagnosis(name, False, seed).causes
