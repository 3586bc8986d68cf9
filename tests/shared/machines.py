"""The machines of docs/how-to/machines.md as they really are: other equations, and another integrator."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.integrate import solve_ivp

from deatwin.plant import Plant, Recording

PAGE = Path(__file__).parents[2] / "docs/how-to/machines.md"
Rng = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What is concealed: its name in the catalogue, and numbers that the generator knows."""

    name: str = ""
    values: Mapping[str, float] = field(default_factory=dict)

    def get(self, name: str, key: str) -> float:
        return self.values[key] if self.name == name else 0.0


def drawn_log(rng: Rng, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine as it really is."""

    rates: Callable[[Hidden, np.ndarray, float], list[float]]
    reading: Callable[[np.ndarray, float], float]
    rest: tuple[float, ...]
    levels: tuple[float, float, int, int]  # Lowest and highest command, samples of a hold, samples
    effects: Mapping[str, Callable[[Rng], dict[str, float]]]


def _motor(hidden: Hidden, x: np.ndarray, u: float) -> list[float]:
    side, (stiction, unevenness) = np.tanh(x[0] / 0.05), (hidden.values.get(k, 0.0) for k in ("stiction", "unevenness"))
    level = (1 + unevenness * side) * (1 + stiction * np.exp(-((x[0] / 4.0) ** 2)))
    friction = hidden.get("coulomb_friction", "force") * side * level
    return [(0.048 * (u - 0.048 * x[0]) / 2.0 - 1.2e-5 * x[0] - friction) / 1.1e-4]


def _cylinder(hidden: Hidden, x: np.ndarray, u: float) -> list[float]:
    gap = hidden.get("dead_zone", "width")
    inflow = 3.3e-5 * np.sign(u) * max(abs(u) - gap, 0.0) - 5e-10 * 1e5 * x[2] - 5e-4 * x[1]
    friction = hidden.get("coulomb_friction", "force") * np.tanh(x[1] / 1e-4)
    return [x[1], (5e-4 * 1e5 * x[2] - 2200.0 * x[0] - 60.0 * x[1] - friction) / 2.0, inflow / 1.1e-10 / 1e5]


def _room(hidden: Hidden, x: np.ndarray, u: float) -> list[float]:
    problem, time = hidden.get("relaxation", "stiffness"), hidden.get("relaxation", "time") or 1.0
    into_walls, into_bench = 140.0 * (x[0] - x[1]), problem * (x[0] - x[2])
    return [(u - into_walls - 35.0 * x[0] - into_bench) / 1.2e4, (into_walls - 90.0 * x[1]) / 4e5, (x[0] - x[2]) / time]


def _battery(hidden: Hidden, x: np.ndarray, u: float) -> list[float]:
    slow, time = hidden.get("relaxation", "resistance"), hidden.get("relaxation", "time") or 1.0
    heating = u * (0.032 * (1 - 0.012 * x[3]) * u + x[1] + x[2]) - 0.12 * x[3]
    return [-u / 9000.0, (0.018 * u - x[1]) / 9.0, (slow * u - x[2]) / time, heating / 40.0]


MACHINES = {
    "motor": Machine(
        rates=_motor,
        reading=lambda x, u: x[0],
        rest=(0.0,),
        levels=(-3.0, 3.0, 20, 1200),
        effects={
            "coulomb_friction": lambda rng: {"force": drawn_log(rng, 2e-3, 8e-3)},
            "delay": lambda rng: {"time": rng.uniform(0.006, 0.03)},
        },
    ),
    "cylinder": Machine(
        rates=_cylinder,
        reading=lambda x, u: x[0],
        rest=(0.0, 0.0, 0.0),
        levels=(-2.5, 2.5, 25, 1200),
        effects={
            "dead_zone": lambda rng: {"width": drawn_log(rng, 0.1, 0.4)},
            "coulomb_friction": lambda rng: {"force": drawn_log(rng, 1.0, 4.0)},
        },
    ),
    "room": Machine(
        rates=_room,
        reading=lambda x, u: x[0],
        rest=(0.0, 0.0, 0.0),
        levels=(0.0, 2000.0, 12, 1200),
        effects={
            "relaxation": lambda rng: {"stiffness": drawn_log(rng, 60.0, 200.0), "time": drawn_log(rng, 200.0, 500.0)},
            "periodic_disturbance": lambda rng: {
                "size": drawn_log(rng, 0.05, 0.3),
                "frequency": drawn_log(rng, 3e-4, 1e-2),
            },
        },
    ),
    "battery": Machine(
        rates=_battery,
        reading=lambda x, u: 3.28 + 0.85 * x[0] - 0.032 * (1 - 0.012 * x[3]) * u - x[1] - x[2],
        rest=(1.0, 0.0, 0.0, 0.0),
        levels=(-2.5, 4.0, 15, 1500),
        effects={
            "relaxation": lambda rng: {"resistance": drawn_log(rng, 8e-3, 2e-2), "time": drawn_log(rng, 60.0, 200.0)},
            "sensor_jump": lambda rng: {"change": drawn_log(rng, 2e-3, 1e-2), "at": rng.uniform(0.2, 0.8)},
        },
    ),
}


def levels(rng: Rng, low: float, high: float, hold: int, number: int) -> np.ndarray:
    return np.repeat(rng.uniform(low, high, number // hold), hold)


def machine_record(
    kind: str, hidden: Hidden, rng: Rng, beside: tuple[float, float, int, int] | None = None
) -> tuple[Plant, Recording]:
    """A recording of a machine with something concealed, and the plant of the page; further levels may be added to those
    of the machine.
    """
    code = re.search(rf'^```python title="{kind}\.py"\n(.*?)^```', PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert code is not None
    module = ModuleType(kind)
    exec(compile(code[1], f"{kind}.py", "exec", dont_inherit=True), vars(module))
    plant, machine = module.plant(), MACHINES[kind]
    commands = levels(rng, *machine.levels)
    if beside is not None:
        commands += levels(rng, *beside)
    width, state, readings = plant.rig.sample_time, np.array(machine.rest), []
    late = hidden.get("delay", "time")
    whole = int(late / width)
    split = width * (late / width - whole)
    for row in range(commands.size):
        pieces = ((split, row - whole - 1), (width - split, row - whole)) if split else ((width, row),)
        for time, acting in pieces:
            u = commands[acting] if acting >= 0 else 0.0
            run = solve_ivp(
                lambda t, x, u=u: machine.rates(hidden, x, u), (0.0, time), state, "LSODA", rtol=1e-8, atol=1e-10
            )
            state = run.y[:, -1]
        readings.append(machine.reading(state, commands[row]))
    clock, read = width * (1 + np.arange(commands.size)), np.array(readings)
    if hidden.name == "sensor_jump":
        read += hidden.values["change"] * (clock > hidden.values["at"] * commands.size * width)
    if hidden.name == "periodic_disturbance":
        read += hidden.values["size"] * np.sin(2 * np.pi * hidden.values["frequency"] * clock + 1.0)
    read += plant.rig.noise * rng.standard_normal(commands.size)
    return plant, Recording.from_arrays(commands, read, width)
