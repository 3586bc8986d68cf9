"""Simulate a plant in pieces without storing its signals, for runs that are too long for memory."""

from __future__ import annotations

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.integrator.march import March, marched, repeated
from deatwin.plant.model import Plant
from deatwin.plant.rest import rest_state


class LongRun:
    """A run of a plant from rest, computed like `Simulator.run` but without a record of the signals."""

    def __init__(self, plant: Plant, start: float) -> None:
        values, command = plant.free_values, plant.rig.start.rest_command
        self._equations = equations = plant.simulator.equations
        # Repeats the compiled sample of a stepper, so that nothing is compiled for long runs alone.
        self._sample = plant.simulator.sample(values, plant.rig.sample_time)
        self._march = March(repeated(self._sample.step, "long_run", 2))
        rest, held = rest_state(equations, command, values), equations.held_inputs(command)
        self._lives, self._time, self._past = rest.found, start, np.full(equations.history, command)
        x, z, d, *_, p, c = self._march.arguments
        x[:], z[:], d[:], p[:], c[:] = rest.x, rest.z, rest.d, values, equations.constants
        self._reading = float(equations.output(rest.x, rest.z, rest.d, held, start, values, equations.constants))

    @property
    def reading(self) -> float:
        """Return the reading before the next command, without noise, SI; after a failure, the last known reading."""
        return self._reading

    def readings(self, commands: Array) -> Array | None:
        """Continue the run; return the reading before each command. Shapes: `commands` (n,); returns (n,)."""
        after = self._ends(self._inputs(commands)) if self._lives else None
        if after is None:
            self._lives = False
            return None
        before = np.concatenate([[self._reading], after[:-1]])
        self._reading, self._time = float(after[-1]), self._time + self._sample.sample_time * commands.size
        return before

    def _inputs(self, commands: Array) -> Array:
        """Return the inputs of each sample, shape (n_u, n), including past commands from the previous piece."""
        known = np.concatenate([self._past, commands])
        number = np.arange(-self._past.size, commands.size, dtype=np.float64)
        times = self._time + self._sample.sample_time * number
        inputs = self._equations.inputs(known, 0.0, times)[:, self._past.size :]
        self._past = known[commands.size :]
        return inputs

    def _ends(self, inputs: Array) -> Array | None:
        """Return the readings at the end of each sample; None if one cannot be solved."""
        steps = self._sample.steps
        parts = np.repeat(inputs, steps, axis=1)
        pieces = marched(self._march, 2, parts, self._time, self._sample.sample_time / steps)
        found = np.concatenate([np.empty(0), *(levels[:, 0] for *_, levels, _ in pieces)])
        return found[steps - 1 :: steps] if found.size == parts.shape[1] else None
