"""Controllers of every kind, about 2 V and 1 um."""

from dataclasses import dataclass

import numpy as np
import pytest

from deatwin.control import InverseController, Law, LinearController, ScheduledController, StaticCurve

H = 0.02
COMMON = {
    "sample_time": H,
    "operating_input": 2.0,
    "operating_output": 1.0,
    "command_min": 1.0,
    "command_max": 4.0,
    "closed_loop_time": 0.5,
}


def pi_law(proportional: float, integral: float) -> Law:
    step = integral * H
    return Law.of_error([[1.0]], [step], [1.0], proportional + step)


def some_law() -> Law:
    """Four states of unlike units, one of them an integral; two degrees of freedom."""
    rng = np.random.default_rng(4)
    a = np.diag([1.0, 0.9, 0.5, -0.2]) + np.triu(0.1 * rng.normal(size=(4, 4)), 1)
    return Law(a=a, b=1e3 * rng.normal(size=(4, 2)), c=rng.normal(size=4), d=1e2 * rng.normal(size=2))


@dataclass(frozen=True)
class Made:
    """What the tests ask for by name."""

    pi: LinearController
    general: LinearController
    inverse: InverseController
    falling: InverseController
    scheduled: ScheduledController

    def __getitem__(self, name: str):
        return getattr(self, name)


KINDS = ("pi", "general", "inverse", "falling", "scheduled")


def inverse_of(sign: float) -> InverseController:
    inputs = np.linspace(0.5, 4.5, 41)
    curve = StaticCurve(inputs=inputs, outputs=sign * 0.25 * inputs**2, input_unit="V", output_unit="um")
    rest = sign * 1.0
    demands = sorted(sign * 0.25 * limit**2 for limit in (1.0, 4.0))
    wanted = {**COMMON, "operating_input": rest, "operating_output": rest}
    wanted |= {"command_min": demands[0], "command_max": demands[1]}
    feedback = LinearController(name="PI", law=pi_law(0.3, 2.0).feedforward(1.0), windup=np.array([0.1]), **wanted)
    whole = {**COMMON, "operating_output": rest}
    return InverseController(name="PI behind the inverse", feedback=feedback, curve=curve, **whole)


@pytest.fixture(scope="session")
def made() -> Made:
    general = some_law()
    return Made(
        pi=LinearController(name="PI", law=pi_law(0.5, 2.0), windup=np.array([0.08]), **COMMON),
        general=LinearController(name="general", law=general, windup=follower(general), **COMMON),
        inverse=inverse_of(1.0),
        falling=inverse_of(-1.0),
        scheduled=ScheduledController(
            name="scheduled PI",
            points=np.array([1.5, 2.0, 3.0]),
            laws=(pi_law(0.9, 3.0), pi_law(0.5, 2.0), pi_law(0.2, 1.0)),
            windup=np.array([0.1]),
            **COMMON,
        ),
    )


def follower(law: Law) -> np.ndarray:
    """A gain that makes A - L C nilpotent but for rounding (Ackermann's formula on the dual pair)."""
    n = law.c.size
    seen = np.array([law.c @ np.linalg.matrix_power(law.a, k) for k in range(n)])
    return np.asarray(np.linalg.matrix_power(law.a, n) @ np.linalg.solve(seen, np.eye(n)[-1]))
