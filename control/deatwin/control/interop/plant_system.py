"""The physics plant as a state space that advances one sample at a time by one implicit step."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.rest import has_equilibrium, rest_state
from deatwin.plant.rest_path import rest_under
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.sample import Sample
from deatwin.plant.simulate import RunStatus

if TYPE_CHECKING:
    from control import NonlinearIOSystem


Params = Mapping[str, Any]
After = tuple[Array, float]  # State after a sample, and the reading there, SI


class PlantSystem:
    """A plant that is simulated sample by sample, from any state."""

    # States are deviations from rest in units of their typical sizes, because python-control starts at zero, and so
    # that the fixed steps of `control.linearize` suit all of them.

    def __init__(self, plant: Plant) -> None:
        self._plant, self._equations, self._values = plant, plant.equations, plant.free_values
        self._rest_command = plant.rig.start.rest_command
        self._rest = rest_state(self._equations, self._rest_command, self._values)
        if not self._rest.found:
            raise SimulationError(self._rest.fault)
        self._at_rest = np.concatenate([self._rest.x, self._rest.z])
        self._reads_before = plant.rig.reading is ReadingTime.START_OF_HOLD
        # A reading at the start of a hold still shows the previous hold.
        self._memory = self._equations.history + int(self._reads_before)
        self._last: tuple[tuple[float, bytes, float], After] | None = None

    @cached_property
    def _sample(self) -> Sample:
        return self._plant.simulator.sample(self._values, self._plant.rig.sample_time)

    @property
    def labels(self) -> list[str]:
        """Names of the states."""
        past = [f"{self._plant.rig.input_name}(k-{lag})" for lag in range(1, self._memory + 1)]
        return [*self._equations.states, *self._equations.coordinates, *past]

    def state(self, x: Array, z: Array, command: float) -> Array:
        """Return the system's state (n_states,) after a long constant command. Shapes: `x, z` (n_x,)."""
        unknowns = (np.concatenate([x, z]) - self._at_rest) / self._equations.scale
        return np.concatenate([unknowns, np.full(self._memory, command - self._rest_command)])

    def rest(self, command: float) -> Array:
        """The state of rest under a constant command. Shapes: returns (n_states,)."""
        found = rest_under(self._plant, command)
        if found is None or not self._bears(command):
            raise SimulationError(
                f"the plant has no rest in reach at a command of {command:g} {self._plant.rig.input_unit}: "
                f"{RunStatus.PULL_IN.value}"
            )
        return self.state(*found[:2], command)

    def output(self, t: float, x: Array, u: Array, params: Params) -> Array:
        """Return the reading of a row, when the rig reads it. Shapes: `x` (n_states,); `u` (1,); returns (1,)."""
        if not self._reads_before:
            return np.array([self._after(t, x, u)[1]])
        self._require_finite(t, x, u)
        unknowns, past = self._split(x)
        n_x = len(self._equations.states)
        inputs = self._inputs(past, t - self._plant.rig.sample_time)
        point = (unknowns[:n_x], unknowns[n_x:], self._rest.d, inputs, t, self._values, self._equations.constants)
        return np.array([float(self._equations.output(*point))])

    def update(self, t: float, x: Array, u: Array, params: Params) -> Array:
        """The state after a sample. Shapes: returns (n_states,)."""
        return self._after(t, x, u)[0]

    def to_control(self, name: str | None) -> NonlinearIOSystem:
        """The discrete system of python-control."""
        import control

        rig = self._plant.rig
        return control.nlsys(
            self.update,
            self.output,
            name=name,
            dt=rig.sample_time,
            states=self.labels,
            inputs=[rig.input_name],
            outputs=[rig.output_name],
        )

    def _after(self, t: float, x: Array, u: Array) -> After:
        """Return the state after a sample, and its reading; cached, because output and update both need them."""
        self._require_finite(t, x, u)
        command = float(np.ravel(u)[0])  # python-control may pass a bare number for a plant without memory
        key = (float(t), np.asarray(x, dtype=np.float64).tobytes(), command)
        if self._last is None or self._last[0] != key:
            self._last = key, self._solved(float(t), x, command)
        state, reading = self._last[1]
        return state.copy(), reading

    def _solved(self, time: float, state: Array, command: float) -> After:
        unknowns, past = self._split(state)
        n_x, commands = len(self._equations.states), np.concatenate([[command], past])
        found = self._sample(unknowns[:n_x], unknowns[n_x:], self._rest.d, self._inputs(commands, time), time)
        if found is None:
            raise SimulationError(self._why(time, command))
        x, z, reading = found
        there = np.concatenate([np.asarray(x).ravel(), np.asarray(z).ravel()])
        kept = commands[: self._memory] - self._rest_command
        return np.concatenate([(there - self._at_rest) / self._equations.scale, kept]), reading

    def _split(self, state: Array) -> tuple[Array, Array]:
        """Split a state into unknowns, SI, and past commands, in their unit."""
        # python-control passes an empty list for a plant without memory.
        values, n = np.asarray(state, dtype=np.float64), self._at_rest.size
        return self._at_rest + self._equations.scale * values[:n], self._rest_command + values[n : n + self._memory]

    def _inputs(self, commands: Array, begin: float) -> Array:
        """Return the inputs of a sample from its command, the earlier commands and its start time, s."""
        inputs = self._equations.held_inputs(self._rest_command)
        count = 1 + self._equations.history
        inputs[:count] = commands[:count]
        if self._equations.sample_start is not None:
            inputs[self._equations.sample_start] = begin
        return inputs

    def _require_finite(self, t: float, x: Array, u: Array) -> None:
        if not (np.isfinite(x).all() and np.isfinite(u).all()):
            raise SimulationError(f"at {t:g} s the command ({np.ravel(u)[0]:g}) or the plant's state is not finite")

    def _why(self, time: float, command: float) -> str:
        where = f"the plant stops at {time:g} s under a command of {command:g} {self._plant.rig.input_unit}"
        if not self._bears(command):
            return f"{where}: {RunStatus.PULL_IN.value}"
        return f"{where}: {RunStatus.NOT_SOLVED.value}, or the state that it started from is none of the plant's"

    def _bears(self, command: float) -> bool:
        """Return whether there is an equilibrium with the film in tension under a command."""
        return has_equilibrium(self._equations, self._rest, self._rest_command, command, self._values)
