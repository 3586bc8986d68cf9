"""Controllers of every kind, about 2 V and 1 um."""

from __future__ import annotations

from typing import Any

import numpy as np

from deatwin.control import InverseController, Law, LinearController, ScheduledController, StaticCurve
from deatwin.control.controllers.base import Controller

H = 0.02
COMMON: dict[str, Any] = {
    "sample_time": H,
    "operating_input": 2.0,
    "operating_output": 1.0,
    "command_min": 1.0,
    "command_max": 4.0,
    "closed_loop_time": 0.5,
}
KINDS = ("pi", "general", "inverse", "falling", "scheduled")


def made_controllers() -> dict[str, Controller]:
    """One of each kind; the general one has four states of unlike units, one of them an integral."""
    rng = np.random.default_rng(4)
    a = np.diag([1.0, 0.9, 0.5, -0.2]) + np.triu(0.1 * rng.normal(size=(4, 4)), 1)
    general = Law(a=a, b=1e3 * rng.normal(size=(4, 2)), c=rng.normal(size=4), d=1e2 * rng.normal(size=2))
    return {
        "pi": LinearController(name="PI", law=pi_law(0.5, 2.0), windup=np.array([0.08]), **COMMON),
        "general": LinearController(name="general", law=general, windup=follower(general), **COMMON),
        "inverse": inverse_of(1.0),
        "falling": inverse_of(-1.0),
        "scheduled": ScheduledController(
            name="scheduled PI",
            points=np.array([1.5, 2.0, 3.0]),
            laws=(pi_law(0.9, 3.0), pi_law(0.5, 2.0), pi_law(0.2, 1.0)),
            windup=np.array([0.1]),
            **COMMON,
        ),
    }


def pi_law(proportional: float, integral: float) -> Law:
    step = integral * H
    return Law.of_error([[1.0]], [step], [1.0], proportional + step)


def inverse_of(sign: float, points: int = 41, wave: float = 0.0) -> InverseController:
    """Behind the inverse of a square, waving or not, which falls with a sign of -1."""
    inputs = np.linspace(0.5, 4.5, points)
    outputs = sign * (0.25 * inputs**2 + wave * np.sin(3 * inputs))
    curve = StaticCurve(inputs=inputs, outputs=outputs, input_unit="V", output_unit="um")
    rest = float(curve.output(2.0))
    low, high = sorted(float(curve.output(limit)) for limit in (1.0, 4.0))
    inner = {**COMMON, "operating_input": rest, "operating_output": rest, "command_min": low, "command_max": high}
    feedback = LinearController(name="PI", law=pi_law(0.3, 2.0).feedforward(1.0), windup=np.array([0.1]), **inner)
    whole = {**COMMON, "operating_output": rest}
    return InverseController(name="PI behind the inverse", feedback=feedback, curve=curve, **whole)


def follower(law: Law) -> np.ndarray:
    """A gain that makes A - L C nilpotent but for rounding (Ackermann's formula on the dual pair)."""
    n = law.c.size
    seen = np.array([law.c @ np.linalg.matrix_power(law.a, k) for k in range(n)])
    return np.asarray(np.linalg.matrix_power(law.a, n) @ np.linalg.solve(seen, np.eye(n)[-1]))
