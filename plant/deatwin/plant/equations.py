"""From a rig and its effects to one semi-explicit, index-1 differential-algebraic equation (DAE).

.. math::
    M(p)\\,\\dot x = f(x, z, d, u, t, p), \\qquad 0 = g(x, z, d, u, t, p), \\qquad y = h(x, z, d, u, t, p)

with states *x*, algebraic coordinates *z*, quantities *d* held at their value at rest, inputs *u* (the command,
its past samples and further channels, where effects ask for them), clock *t* and parameters *p*. A zero on the
diagonal of *M* turns a state into an algebraic one, so that a vanishing time constant is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from deatwin.plant.integrator.parts import Step, halves
from deatwin.plant.parameters import ParameterSet

__all__ = ["KNOWN", "SAMPLE_START", "STEP_MIDDLE", "Equations"]

SAMPLE_START = "sample_start"
"""Name of the input that is the clock time at which a sample begins, s."""
STEP_MIDDLE = "step_middle"
"""Name of the input that is the clock time of the middle of a step, s; what asks for it divides each sample in two."""
KNOWN = (SAMPLE_START, STEP_MIDDLE)
"""Inputs that nobody measures: they are known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """The DAE as CasADi Functions and plain data, so that it can go to worker processes.

    Parameters
    ----------
    states, coordinates, held, signals : tuple of str
        Names of x, z, d and of the watched signals.
    scale : ndarray, shape (n_x + n_z,)
        Typical size of each unknown, SI.
    constants : ndarray, shape (n_c,)
        Known parameters and numbers of the rig, SI.
    parameters : ParameterSet
        All parameters; the free ones are the argument *p* of the functions.
    dynamics : casadi.Function
        ``(x, z, d, u, t, p, c) -> (f; g)``. In a step over a part of a sample f and t are those of the step, whose
        clock runs at its own pace (`deatwin.plant.integrator.parts`).
    mass : casadi.Function
        ``(p, c) -> diag M``, shape (n_x,).
    output : casadi.Function
        ``(x, z, d, u, t, p, c) -> h``.
    watched : casadi.Function
        ``(x, z, d, u, t, p, c) ->`` the named signals.
    rest : casadi.Function
        ``(x, z, u, p, c) ->`` residual whose zero is the state of rest.
    guess : casadi.Function
        ``(p, c) -> (x; z)`` to start the search of the rest state.
    hold : casadi.Function
        ``(x, z, p, c) -> d`` at rest.
    history : int
        How many past samples of the command follow it in *u*.
    channels : mapping of str to float
        Further inputs at the end of *u*, each with the value that it has where nobody measured it. Those that are
        `KNOWN` are measured by nobody.
    """

    states: tuple[str, ...]
    coordinates: tuple[str, ...]
    held: tuple[str, ...]
    signals: tuple[str, ...]
    scale: np.ndarray
    constants: np.ndarray
    parameters: ParameterSet
    dynamics: ca.Function
    mass: ca.Function
    output: ca.Function
    watched: ca.Function
    rest: ca.Function
    guess: ca.Function
    hold: ca.Function
    history: int = 0
    channels: Mapping[str, float] = field(default_factory=dict)

    def held_inputs(self, command: float) -> np.ndarray:
        """Inputs under a command that has long been constant.

        Parameters
        ----------
        command : float
            In its unit.

        Returns
        -------
        ndarray, shape (n_u,)
            Channels at the value that they have where nobody measured them.
        """
        return np.array([command] * (1 + self.history) + list(self.channels.values()))

    @property
    def names_of_rest(self) -> tuple[str, ...]:
        """What an error text calls the equations of rest, in the order of the unknowns."""
        rates = (f"the rate of state {name}" for name in self.states)
        return (*rates, *(f"the balance for coordinate {name}" for name in self.coordinates))

    @property
    def sample_start(self) -> int | None:
        """Where in *u* the clock time at which a sample begins is; None where no effect asks for it."""
        return self._place_of(SAMPLE_START)

    @property
    def step_middle(self) -> int | None:
        """Where in *u* the clock time of the middle of a step is; None where a sample is not divided."""
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
        """Inputs of each sample.

        Parameters
        ----------
        commands : ndarray, shape (n,)
            In their unit.
        rest_command : float
            What was applied before them.
        times : ndarray, shape (n,)
            Clock time at which each sample begins, s.
        measured : mapping of str to ndarray, each of shape (n,) or longer, optional
            Channels by name, SI.

        Returns
        -------
        ndarray, shape (n_u, n)
        """
        n = commands.size
        before = np.concatenate([np.full(self.history, rest_command), commands])
        past = [before[self.history - k : self.history - k + n] for k in range(self.history + 1)]
        known = {**(measured or {}), SAMPLE_START: times}
        return np.vstack([*past, *(known.get(name, np.full(n, value))[:n] for name, value in self.channels.items())])

    def steps(self, begin: float, width: float) -> tuple[Step, ...]:
        """The steps in which a sample is solved: one, or two where it is divided.

        Parameters
        ----------
        begin, width : float
            When the sample begins, and for how long it lasts, s.

        Returns
        -------
        tuple of Step
        """
        return (Step(begin, begin + width / 2, width),) if self.step_middle is None else halves(begin, width)

    def with_middle(self, inputs: np.ndarray, time: float) -> np.ndarray:
        """Inputs of a step whose middle is at a time.

        Parameters
        ----------
        inputs : ndarray, shape (n_u,)
            Of the sample.
        time : float
            Clock time, s.

        Returns
        -------
        ndarray, shape (n_u,)
        """
        told = inputs.copy()
        if self.step_middle is not None:
            told[self.step_middle] = time
        return told

    @property
    def free_values(self) -> np.ndarray:
        """Values of the free parameters, shape (n_p,), SI."""
        return self.parameters.array(self.parameters.free)
