"""Differential-algebraic equation of a rig and its effects: M(p) dx/dt = f, 0 = g, reading y = h.

f, g and h depend on states x, coordinates z, quantities d held at their values at rest, inputs u (command, its past,
channels), clock t and parameters p. A zero in the diagonal M makes a state algebraic, so zero time constants are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.integrator.parts import Step, halves
from deatwin.plant.parameters import ParameterSet

SAMPLE_START = "sample_start"  # Name of the input for the clock time at which a sample begins, s
STEP_MIDDLE = "step_middle"
"""Name of the input for the clock time in the middle of a step, s; its use divides each sample in two."""
KNOWN = (SAMPLE_START, STEP_MIDDLE)  # Inputs that are known without measurement
STAGES = 5
"""Usual number of stages of an implicit step; its order is ``2 * STAGES - 1``. At 50 samples per second, four stages
follow the ringing of a 16 Hz ball mode after a step to 0.2 µm, and five to 0.003 µm in a third more time
(tests/validation)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """The DAE as CasADi Functions and plain data, so that it can go to worker processes."""

    states: tuple[str, ...]  # Names of the states x
    coordinates: tuple[str, ...]  # Names of the coordinates z
    held: tuple[str, ...]  # Names of the held quantities d
    signals: tuple[str, ...]  # Names of the watched signals
    scale: np.ndarray  # shape (n_x + n_z,): Typical size of each unknown, SI
    constants: np.ndarray  # shape (n_c,): Known parameters and numbers of the rig, SI
    parameters: ParameterSet  # All parameters; the free ones are the argument *p* of the functions
    dynamics: ca.Function
    mass: ca.Function  # ``(p, c) -> diag M``, shape (n_x,)
    output: ca.Function  # ``(x, z, d, u, t, p, c) -> h``
    watched: ca.Function  # ``(x, z, d, u, t, p, c) ->`` the named signals
    rest: ca.Function  # ``(x, z, u, p, c) ->`` residual whose zero is the state of rest
    guess: ca.Function  # ``(p, c) -> (x; z)`` to start the search of the rest state
    hold: ca.Function  # ``(x, z, p, c) -> d`` at rest
    further: ca.Function | None = None  # ``(x, z, d, u, t, p, c) ->`` rows of the further readings, if any
    integrals: Mapping[str, float] = field(default_factory=dict)
    """States that start each sample at zero, each with its value at the end of a sample at rest divided by its rate
    there, s."""
    shifts: Mapping[str, str] = field(default_factory=dict)
    """States that start each sample with another state's final value in the sample before, and keep it, each with the
    name of that other state. They are the last of the states."""
    history: int = 0  # Number of past values of the command that follow the present one in *u*
    channels: Mapping[str, float] = field(default_factory=dict)
    stages: int = STAGES  # Number of stages of the implicit step over a sample

    def outputs(self, *point: Any) -> Any:
        """Return the reading, followed by the rows of the further readings."""
        first = self.output(*point)
        return first if self.further is None else ca.vertcat(first, self.further(*point))

    def symbols(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return symbols for all unknowns w, for d, u, t, p and c; and the arguments of `dynamics` that they make."""
        sizes = {
            "w": self.scale.size,
            "d": len(self.held),
            "u": self.held_inputs(0.0).size,
            "t": 1,
            "p": len(self.parameters.free),
            "c": self.constants.size,
        }
        w, *others = (ca.SX.sym(name, size) for name, size in sizes.items())
        n_x = len(self.states)
        return (w, *others), (w[:n_x, :], w[n_x:, :], *others)

    @property
    def begins_at_zero(self) -> np.ndarray:
        """Positions of states that start each sample at zero: integrals for readings that are means."""
        return np.array([self.states.index(name) for name in self.integrals], dtype=int)

    @property
    def begun(self) -> np.ndarray:
        """Return the matrix (n_x, n_x) from the states at the end of a sample to those at the start of the next."""
        matrix = np.eye(len(self.states))
        matrix[self.begins_at_zero] = 0.0
        for state, source in self.shifts.items():
            matrix[self.states.index(state)] = np.eye(len(self.states))[self.states.index(source)]
        return matrix

    @property
    def moving(self) -> np.ndarray:
        """Positions of the unknowns that a step solves for: all except states that only store a value."""
        return np.delete(np.arange(self.scale.size), [self.states.index(name) for name in self.shifts])

    def held_inputs(self, command: float) -> np.ndarray:
        """Return the inputs under a command that has been constant for long. Shapes: returns (n_u,)."""
        return np.array([command] * (1 + self.history) + list(self.channels.values()))

    @property
    def names_of_rest(self) -> tuple[str, ...]:
        """Names of the equations of rest in error texts, in the order of the unknowns."""
        rates = (f"the rate of state {name}" for name in self.states)
        return (*rates, *(f"the balance for coordinate {name}" for name in self.coordinates))

    @property
    def sample_start(self) -> int | None:
        """Position in *u* of the clock time at which a sample begins; None if no effect needs it."""
        return self._place_of(SAMPLE_START)

    @property
    def step_middle(self) -> int | None:
        """Position in *u* of the clock time in the middle of a step; None if samples are not divided."""
        return self._place_of(STEP_MIDDLE)

    def _place_of(self, channel: str) -> int | None:
        names = list(self.channels)
        return 1 + self.history + names.index(channel) if channel in names else None

    def inputs(
        self,
        commands: np.ndarray,
        rest_command: float,
        times: np.ndarray,
        measured: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Return the inputs of each sample. Shapes: `commands` (n,); `times` (n,); `measured` (n,); returns (n_u, n)."""
        n = commands.size
        before = np.concatenate([np.full(self.history, rest_command), commands])
        past = [before[self.history - k : self.history - k + n] for k in range(self.history + 1)]
        known = {**(measured or {}), SAMPLE_START: times}
        return np.vstack([*past, *(known.get(name, np.full(n, value))[:n] for name, value in self.channels.items())])

    def steps(self, begin: float, width: float) -> tuple[Step, ...]:
        """Return the steps for a sample of `width` that starts at `begin`, s: one, or two if the sample is divided."""
        return (Step(begin, begin + width / 2, width),) if self.step_middle is None else halves(begin, width)

    def with_middle(self, inputs: np.ndarray, time: float) -> np.ndarray:
        """Return the inputs of a step with a given middle time. Shapes: `inputs` (n_u,); returns (n_u,)."""
        told = inputs.copy()
        if self.step_middle is not None:
            told[self.step_middle] = time
        return told

    @property
    def free_values(self) -> np.ndarray:
        """Values of the free parameters, shape (n_p,), SI."""
        return self.parameters.array(self.parameters.free)
