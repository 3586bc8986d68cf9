"""Simulate one sample of a plant from any state, in shorter steps if one step cannot be solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.integrator.newton import SETTLED

SHORTER_STEPS = (4, 16, 64)  # Numbers of shorter steps, tried in turn if one step does not solve a sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """One sample of a plant under a held command."""

    step: ca.Function  # Function of one step, as `StepFunctions.plain`
    sample_time: float  # s
    values: np.ndarray  # shape (n_p,): Free parameters, SI
    constants: np.ndarray  # shape (n_c,): Constants of the equations, SI
    steps: int = 1  # Number of steps if these can be solved

    def __call__(
        self, x: Any, z: Any, held: np.ndarray, inputs: np.ndarray, time: float
    ) -> tuple[ca.DM, ca.DM, float] | None:
        """Return states, coordinates and reading at the sample's end; None if unsolved. `x, z` (n_x,); `held`."""
        tried = (self._in_steps(x, z, held, inputs, time, n) for n in (1, *SHORTER_STEPS))
        return next((found for found in tried if found is not None), None)

    def _in_steps(
        self, x: Any, z: Any, held: np.ndarray, inputs: np.ndarray, time: float, number: int
    ) -> tuple[ca.DM, ca.DM, float] | None:
        """Solve the sample, with each of its steps in a `number` of shorter ones; None if one cannot be solved."""
        number *= self.steps
        width, level = self.sample_time / number, ca.DM(np.nan)
        for count in range(number):
            begin = time + width * count
            x, z, level, _, error = self.step(x, z, held, inputs, begin, width, self.values, self.constants)
            if not solved(error, level, 1):
                return None
        return x, z, float(level[0])


def solved(error: np.ndarray | ca.DM, reading: np.ndarray | ca.DM, count: int) -> int:
    """Return how many of the first `count` samples are solved; `error` (n, ...), `reading` (n, rows)."""
    errors = np.asarray(error).ravel()
    readings = np.asarray(reading).reshape(errors.size, -1)[:count]
    bad = ~((errors[:count] <= SETTLED) & np.isfinite(readings).all(axis=1))
    return int(np.argmax(bad)) if bad.any() else count
