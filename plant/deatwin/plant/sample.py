"""One sample of a plant from any state, and what a simulation does where it cannot be solved in one step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.integrator.newton import SETTLED

__all__ = ["SHORTER_STEPS", "Sample", "solved"]

SHORTER_STEPS = (4, 16, 64)
"""Into how many steps a sample is divided that is not solved in one, one number after the other."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """One sample of a plant under a held command.

    Parameters
    ----------
    step : casadi.Function
        One step, as `StepFunctions.plain`.
    sample_time : float
        s.
    values : ndarray, shape (n_p,)
        Free parameters, SI.
    constants : ndarray, shape (n_c,)
        Of the equations, SI.
    """

    step: ca.Function
    sample_time: float
    values: np.ndarray
    constants: np.ndarray

    def __call__(
        self, x: Any, z: Any, held: np.ndarray, inputs: np.ndarray, time: float
    ) -> tuple[ca.DM, ca.DM, float] | None:
        """States, coordinates and reading at the end of the sample.

        Parameters
        ----------
        x, z : array_like, shapes (n_x,) and (n_z,)
            States and coordinates at its start, SI; the search of the coordinates starts from these.
        held : ndarray, shape (n_d,)
            Held quantities, SI.
        inputs : ndarray, shape (n_u,)
            As `Equations.inputs`.
        time : float
            Clock time of the start, s.

        Returns
        -------
        tuple of (casadi.DM, casadi.DM, float), or None
            SI; None where the sample is not solved in any number of steps.
        """
        tried = (self._in_steps(x, z, held, inputs, time, n) for n in (1, *SHORTER_STEPS))
        return next((found for found in tried if found is not None), None)

    def _in_steps(
        self, x: Any, z: Any, held: np.ndarray, inputs: np.ndarray, time: float, number: int
    ) -> tuple[ca.DM, ca.DM, float] | None:
        """After so many steps; None where one is not solved."""
        width, level = self.sample_time / number, ca.DM(np.nan)
        for count in range(number):
            begin = time + width * count
            x, z, level, _, error = self.step(x, z, held, inputs, begin, width, self.values, self.constants)
            if not solved(error, level, 1):
                return None
        return x, z, float(level)


def solved(error: np.ndarray | ca.DM, reading: np.ndarray | ca.DM, count: int) -> int:
    """How many of the first samples were solved and have finite readings.

    Parameters
    ----------
    error : array_like, shape (n, ...)
        What Newton's method left.
    reading : array_like, shape (n, ...)
        SI.
    count : int
        How many samples count.

    Returns
    -------
    int
        Samples before the first that is not valid.
    """
    errors, readings = (np.asarray(v).ravel()[:count] for v in (error, reading))
    bad = ~((errors <= SETTLED) & np.isfinite(readings))
    return int(np.argmax(bad)) if bad.any() else count
