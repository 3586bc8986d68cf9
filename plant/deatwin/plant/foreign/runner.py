"""Simulation of a foreign model between the effects before and behind it, with derivatives by differences.

The equations of drive and sensor run twice. A first run gives the commands, and the parameters that vary; with these
the model is called; in a second run its readings, linear within a sample, pass the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.foreign.calls import Answer, Call, Model, answers
from deatwin.plant.parameters import Parameter, ParameterSet, Scale
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.simulate import Given, Progress, Run, RunStatus, Simulator

APPLIED = "applied_command"
"""Watched signal: in the equations, the integral of the command since the start; in results, its mean over a sample."""
VARYING = "varying_"  # Prefix of a varying parameter's name in the name of its watched signal
BEFORE, AFTER = "model_reading_before", "model_reading"
"""Inputs of the equations: readings of the model at the beginning and at the end of a sample."""
OF_RANGE = 0.1
"""Size of a parameter near zero, as a share of its range: ranges of effects are some ten times typical values."""


@dataclass(frozen=True, kw_only=True)
class ForeignRunner:
    """Run a plant with a foreign model; `simulator` has the equations around it, a `ForeignRig` the rest."""

    model: Model
    own: tuple[Parameter, ...]  # Parameters of the model
    channels: tuple[tuple[str, float], ...]
    input_name: str
    output_name: str
    reading: ReadingTime
    step: float
    longest: float
    simulator: Simulator
    parameters: ParameterSet  # Parameters of the whole plant

    def run(self, commands: np.ndarray, *, progress: Progress | None = None, **given: Unpack[Given]) -> Run:
        """Simulate. Shapes: `commands` (n,)."""
        around, values = _Around(self, commands, given), given["values"]
        called = around.call(values)
        if isinstance(called, Run):
            return called
        (answer,) = answers(self.model, [called], self.longest)
        return around.read(answer, values, called)

    def run_with_sensitivities(self, commands: np.ndarray, **given: Unpack[Given]) -> Run:
        """Simulate with derivatives: exact for parameters behind the model only, else central differences."""
        around, values = _Around(self, commands, given), given["values"]
        base = around.call(values)
        if isinstance(base, Run):
            return base
        digest = base.digest()
        moved: dict[tuple[int, int], tuple[Array, Call]] = {}
        for number, name in enumerate(self.parameters.free):
            for side, value in enumerate(self._ends(self.parameters[name], float(values[number]))):
                there = np.array(values, dtype=float)
                there[number] = value
                called = around.call(there)
                if isinstance(called, Call) and called.digest() != digest:
                    moved[number, side] = (there, called)
        first, *others = answers(self.model, [base, *(call for _, call in moved.values())], self.longest)
        run = around.read(first, values, base, sensitive=True)
        if not run.status.ok or run.sensitivities is None:
            return run
        reached = {
            key: (there, around.read(answer, there, call))
            for (key, (there, call)), answer in zip(moved.items(), others, strict=True)
        }
        slopes = np.array(run.sensitivities)
        for number in {number for number, _ in moved}:
            # If one side fails or lies outside the range, the other side and the middle give the slope.
            sides = [reached[number, side] for side in (0, 1) if (number, side) in reached]
            ends = [(there[number], other.outputs) for there, other in sides if other.status.ok]
            if not ends:
                return _failed(sides[0][1].advice)
            low, high = ends if len(ends) == 2 else [(float(values[number]), run.outputs), ends[0]]
            slopes[:, number] = (high[1] - low[1]) / (high[0] - low[0])
        return replace(run, sensitivities=slopes)

    def _ends(self, parameter: Parameter, value: float) -> tuple[float, float]:
        """Return two values on either side of one, inside the range."""
        width = self.step * abs(value)
        if parameter.scale is Scale.LINEAR and np.isfinite(parameter.upper - parameter.lower):
            width = max(width, self.step * OF_RANGE * (parameter.upper - parameter.lower))
        width = width or self.step
        return max(value - width, parameter.lower), min(value + width, parameter.upper)


class _Around:
    """The parts of a plant before and after the model, in one experiment."""

    def __init__(self, runner: ForeignRunner, commands: np.ndarray, given: Given) -> None:
        self._runner, self._simulator, self._parameters = runner, runner.simulator, runner.parameters
        self._commands, self._given = commands, given
        self._channels = given.get("channels") or {}
        self._time: Array = given["start"] + given["sample_time"] * np.arange(commands.size, dtype=float)

    def call(self, values: np.ndarray) -> Call | Run:
        """Return the arguments for the model, or the failed run."""
        runner = self._runner
        numbers = dict(zip(self._parameters.free, values, strict=True))
        parameters = {p.name: float(numbers.get(p.name, p.value)) for p in runner.own}
        inputs = {name: self._channel(name, default) for name, default in runner.channels}
        inputs = {runner.input_name: np.asarray(self._commands, dtype=float), **inputs}
        if self._simulator.equations.signals:
            given: Given = {**self._given, "values": values}
            run = self._simulator.run(self._commands, **given)
            if not run.status.ok or run.watched is None:
                return replace(run, outputs=run.outputs[:0], watched=None, failed_at=None)
            for name, signal in zip(self._simulator.equations.signals, run.watched, strict=True):
                if name == APPLIED:
                    inputs[runner.input_name] = np.diff(signal, prepend=0.0) / self._given["sample_time"]
                elif name.startswith(VARYING):
                    parameters[name.removeprefix(VARYING)] = signal
        return Call(parameters=parameters, inputs=inputs, time=self._time, output=runner.output_name)

    def read(self, answer: Answer, values: np.ndarray, call: Call, *, sensitive: bool = False) -> Run:
        """Simulate the sensor that reads an answer, optionally with derivatives by parameters after the model."""
        if answer.readings is None:
            return _failed(answer.fault)
        readings = answer.readings
        if self._runner.reading is ReadingTime.START_OF_HOLD:
            before, after = readings, np.concatenate([readings[1:], readings[-1:]])
        else:
            before, after = np.concatenate([readings[:1], readings[:-1]]), readings
        first = float(readings[0])
        simulator = self._simulator.resting({BEFORE: first, AFTER: first})
        run = simulator.run_with_sensitivities if sensitive else simulator.run
        channels = {**self._channels, BEFORE: before, AFTER: after}
        given: Given = {**self._given, "values": values, "channels": channels}
        found = run(self._commands, **given)
        return replace(found, watched=self._watched(found.watched, call), watched_at_rest=None)

    def _watched(self, watched: np.ndarray | None, call: Call) -> np.ndarray | None:
        if watched is None or APPLIED not in self._simulator.equations.signals:
            return watched
        row = self._simulator.equations.signals.index(APPLIED)
        return np.insert(np.delete(watched, row, axis=0), row, call.inputs[self._runner.input_name], axis=0)

    def _channel(self, name: str, default: float) -> Array:
        given = self._channels.get(name)
        count = self._commands.size
        return np.full(count, default) if given is None else np.asarray(given[:count], dtype=float)


def _failed(fault: str) -> Run:
    return Run(
        status=RunStatus.NOT_SOLVED,
        outputs=np.empty(0),
        sensitivities=None,
        watched=None,
        failed_at=None,
        advice=f"the model that was written elsewhere gave no readings: {fault}",
    )
