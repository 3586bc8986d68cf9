"""Simulation of a plant over a sequence of held commands, with exact sensitivities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, partial
from typing import Any, NotRequired, Protocol, TypedDict, Unpack

import casadi as ca
import numpy as np

from deatwin.plant.branch import ACTED_ON, snap_throughs
from deatwin.plant.equations import Equations
from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.collocation import StepFunctions, step_functions
from deatwin.plant.integrator.compiled import compile_functions, key_of, recalled
from deatwin.plant.integrator.march import CHUNK, March, marched, repeated
from deatwin.plant.readings import combined, combined_slopes
from deatwin.plant.rest import NO_REST, RestState, has_equilibrium, rest_state, undefined_ahead
from deatwin.plant.sample import Sample

Progress = Callable[[float], None]
NO_READING = "the reading has no finite value at rest: a quotient by zero, or a logarithm or a root there"
NO_EQUILIBRIUM = (
    "the plant has no equilibrium under this command, or runs away from it: lower the command, or check its equations"
)
"""Text of `RunStatus.PULL_IN` for a rig without a film."""
MARCHES = ("plain_march", "sensitive_march")


class RunStatus(Enum):
    """How a simulation ended. The value of each member is a message for the user."""

    DONE = "the simulation reached its end"
    TENSION_LOST = "the film lost tension and would wrinkle, so later results are invalid: lower the voltage or stretch the film more"
    BREAKDOWN = "the field exceeded the film's dielectric strength, so later results are invalid: lower the voltage"
    SNAP_THROUGH = "the film snapped to another equilibrium: a lower voltage, or a stiffer film, keeps it on the first"
    NO_REST = NO_REST
    PULL_IN = "no equilibrium is in reach (pull-in or loss of tension): lower the voltage or stiffen the film"
    NOT_SOLVED = "the equations of a sample could not be solved: a parameter may be far off, or the sampling too slow"

    @property
    def ok(self) -> bool:
        """True if the simulation reached its end, even if the film lost tension or broke down on the way."""
        return self in (RunStatus.DONE, RunStatus.SNAP_THROUGH, RunStatus.TENSION_LOST, RunStatus.BREAKDOWN)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Result of a simulation."""

    status: RunStatus  # How the simulation ended
    outputs: np.ndarray  # shape (1 + m,): Reading at rest, then at the end of each valid sample, SI
    sensitivities: np.ndarray | None  # shape (1 + m, n_p): Derivative of `outputs` by the free parameters
    watched: np.ndarray | None
    failed_at: int | None  # Sample in which the simulation failed
    advice: str  # Text of the status; for a plant without a state of rest, the equation at fault
    further: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    """Further readings at the same instants, SI, shape (1 + m, k)."""
    further_slopes: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0)))
    """Derivatives of the further readings by the free parameters, shape (1 + m, k, n_p); n_p is 0 in plain runs."""
    watched_at_rest: np.ndarray | None = None  # The named signals before the first sample, shape (n,)
    look_for_snaps: Callable[[], tuple[int, ...]] = tuple  # Search for `snaps` in a plain run; takes as long as the run

    @cached_property
    def snaps(self) -> tuple[int, ...]:
        """Samples in which the film snaps to another equilibrium; only in runs without sensitivities."""
        return self.look_for_snaps()


class Given(TypedDict):
    """Arguments of a run besides its commands."""

    start: float  # Clock time of the first command, s
    sample_time: float  # s
    rest_command: float  # Command under which the plant rests before the first one
    values: np.ndarray  # shape (n_p,): Free parameters
    channels: NotRequired[Mapping[str, np.ndarray] | None]  # shape (n,) each: Further inputs by name


class Runner(Protocol):
    """Interface that fits and diagnoses need: a plant's readings under commands, and their derivatives."""

    def run(self, commands: np.ndarray, *, progress: Progress | None = None, **given: Unpack[Given]) -> Run:
        """Simulate from rest. Shapes: `commands` (n,)."""

    def run_with_sensitivities(self, commands: np.ndarray, **given: Unpack[Given]) -> Run:
        """Simulate from rest together with the derivatives by all free parameters."""


class Simulator:
    """A plant's equations, prepared for simulation."""

    steps = 1  # Number of implicit steps in which a run takes each sample

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._in_steps: dict[int, Simulator] = {}
        origin = [equations.dynamics, equations.mass, equations.output, equations.watched]
        origin += [equations.further] if equations.further is not None else []
        key = key_of(origin, np.append(equations.scale, equations.stages))
        self._march = recalled(MARCHES, key) or self._marches(key)

    def _marches(self, key: str | None) -> dict[str, ca.Function]:
        """Return the step, without and with sensitivities, repeated over a piece of a record."""
        step, (plain, sensitive) = self._single, MARCHES
        marches = {plain: repeated(step.plain, plain, 2), sensitive: repeated(step.sensitive, sensitive, 3)}
        return compile_functions(marches, in_lanes=step.in_lanes, key=key)

    def resting(self, channels: Mapping[str, float]) -> Simulator:
        """Return the simulator with other values of further inputs at rest, by name."""
        other = copy(self)
        other.equations, other._in_steps = replace(self.equations, channels={**self.equations.channels, **channels}), {}
        return other

    def in_steps(self, count: int) -> Simulator:
        """Return the simulator that takes each sample in several steps, under the same inputs."""
        if count == self.steps:
            return self
        if count not in self._in_steps:  # which then keeps its own compiled step
            other = copy(self)
            other.steps, other._in_steps = count, {}
            self._in_steps[count] = other
        return self._in_steps[count]

    @cached_property
    def _single(self) -> StepFunctions:
        return step_functions(self.equations)

    def run(self, commands: np.ndarray, *, progress: Progress | None = None, **given: Unpack[Given]) -> Run:
        """Simulate from rest. Shapes: `commands` (n,)."""
        opening = self._opening(commands, given)
        if isinstance(opening, Run):
            return opening
        rest, first, inputs = opening
        sample_time, values = given["sample_time"], given["values"]
        outputs, watched, unknowns = [first], [], [np.empty((len(self.equations.scale), 0))]
        march = March(self._march["plain_march"])
        x, z, d, *_, p, c = march.arguments
        x[:], z[:], d[:], p[:], c[:] = rest.x, rest.z, rest.d, values, self.equations.constants
        taken, parts = 0, np.repeat(inputs, self.steps, axis=1)
        for found in marched(march, 2, parts, given["start"], sample_time / self.steps):
            ends = self._ends(taken)
            taken += len(found[0])
            after_x, after_z, y, w = (rows[ends] for rows in found)
            outputs.append(y)
            unknowns.append(np.vstack([after_x.T, after_z.T]))
            watched.append(w.T)
            if progress is not None:
                progress(taken / parts.shape[1])
        done = taken // self.steps
        path = np.hstack(unknowns)
        status, fault = self._end(rest, commands[done:], path, inputs[:, done:], given)
        signals = np.hstack(watched) if watched else np.empty((len(self.equations.signals), 0))
        find = partial(snap_throughs, self.equations, rest, path, inputs[:, :done], given["rest_command"], values)
        run, rows = _run(status, [y[:, 0] for y in outputs], None, signals, fault), np.vstack(outputs)[:, 1:]
        held = self.equations.held_inputs(given["rest_command"])
        resting = self.equations.watched(rest.x, rest.z, rest.d, held, given["start"], values, self.equations.constants)
        return replace(
            run,
            look_for_snaps=find,
            further=combined(rows, sample_time),
            watched_at_rest=np.asarray(resting, dtype=np.float64).ravel(),
        )

    def run_with_sensitivities(self, commands: np.ndarray, **given: Unpack[Given]) -> Run:
        """Simulate from rest together with the derivatives by all free parameters."""
        opening = self._opening(commands, given)
        if isinstance(opening, Run):
            return opening
        rest, first, inputs = opening
        sample_time, values = given["sample_time"], given["values"]
        outputs, slopes = [first], [self._rest_slope(rest, given)]
        march = March(self._march["sensitive_march"])
        x, z, dx, dd, d, *_, p, c = march.arguments
        x[:], z[:], dx[:], d[:], p[:], c[:] = rest.x, rest.z, rest.x_p.T, rest.d, values, self.equations.constants
        dd[:] = np.tile(rest.d_p.T, (CHUNK, 1))
        taken, parts = 0, np.repeat(inputs, self.steps, axis=1)
        path = np.empty((len(self.equations.scale), 0))
        for after_x, after_z, *_, y, dy in marched(march, 3, parts, given["start"], sample_time / self.steps):
            ends = self._ends(taken)
            taken += len(y)
            outputs.append(y[ends])
            slopes.append(dy.reshape(len(y), values.size, y.shape[1])[ends])
            path = np.vstack([after_x.T, after_z.T]) if len(y) > 1 else path
        done = taken // self.steps
        status, fault = self._end(rest, commands[done:], path, inputs[:, done:], given)
        by_values, rows = np.concatenate(slopes), np.vstack(outputs)[:, 1:]
        run = _run(status, [y[:, 0] for y in outputs], by_values[:, :, 0], None, fault)
        changes = combined_slopes(rows, by_values[:, :, 1:].swapaxes(1, 2), sample_time)
        return replace(run, further=combined(rows, sample_time), further_slopes=changes)

    def _ends(self, taken: int) -> slice:
        """Return which of the next steps end a sample, after some that were taken."""
        return slice(self.steps - 1 - taken % self.steps, None, self.steps)

    def stepper(self, values: np.ndarray, *, rest_command: float, start: float, sample_time: float) -> Stepper:
        """Return a plant at rest that takes one command at a time, for a loop. Shapes: `values` (n_p,)."""
        rest = rest_state(self.equations, rest_command, values)
        first = self._reading(rest, rest_command, start, values)[0]
        why = partial(self._why, rest, rest_command, values=values)
        return Stepper(self.sample(values, sample_time), self.equations, rest, rest_command, float(first), start, why)

    def sample(self, values: np.ndarray, sample_time: float) -> Sample:
        """Return one sample of the plant, to be solved from any state. Shapes: `values` (n_p,)."""
        return Sample(
            step=self._step,
            sample_time=sample_time,
            values=values,
            constants=self.equations.constants,
            steps=self.steps,
        )

    @cached_property
    def _step(self) -> ca.Function:
        """Return one sample, compiled only for steppers; longer runs use their own copy."""
        return compile_functions({"plain_step": self._single.plain}, in_lanes=self._single.in_lanes)["plain_step"]

    def _reading(self, rest: RestState, command: float, time: float, values: np.ndarray) -> ca.DM:
        inputs = self.equations.held_inputs(command)
        return self.equations.outputs(rest.x, rest.z, rest.d, inputs, time, values, self.equations.constants)

    def _opening(self, commands: np.ndarray, given: Given) -> tuple[RestState, np.ndarray, np.ndarray] | Run:
        """Return the state of rest, the readings there, and the inputs of each sample; or the run that has no rest."""
        rest = rest_state(self.equations, given["rest_command"], given["values"])
        if not rest.found:
            return _run(RunStatus.NO_REST, [np.empty(0)], None, None, rest.fault)
        first = np.asarray(self._reading(rest, given["rest_command"], given["start"], given["values"])).T
        if not np.isfinite(first).all():
            return _run(RunStatus.NO_REST, [np.empty(0)], None, None, NO_READING)
        times = given["start"] + given["sample_time"] * np.arange(commands.size)
        return rest, first, self.equations.inputs(commands, given["rest_command"], times, given.get("channels"))

    def _rest_slope(self, rest: RestState, given: Given) -> np.ndarray:
        held = self.equations.held_inputs(given["rest_command"])
        point = (rest.x, rest.z, rest.d, held, given["start"], given["values"], self.equations.constants)
        pieces = []
        for output in filter(None, (self.equations.output, self.equations.further)):
            names = output.name_in()
            slopes = [
                np.asarray(output.factory("s", names, [f"jac:{output.name_out(0)}:{n}"])(*point))
                for n in (names[0], names[1], names[2], names[5])
            ]
            pieces.append(slopes[0] @ rest.x_p + slopes[1] @ rest.z_p + slopes[2] @ rest.d_p + slopes[3])
        return np.vstack(pieces).T[None]

    def _why(self, rest: RestState, rest_command: float, command: float, values: np.ndarray) -> RunStatus:
        """Return why a sample could not be solved: there is no equilibrium, or the step was too difficult."""
        exists = has_equilibrium(self.equations, rest, rest_command, float(command), values)
        return RunStatus.NOT_SOLVED if exists else RunStatus.PULL_IN

    def _end(
        self, rest: RestState, commands: np.ndarray, path: np.ndarray, inputs: np.ndarray, given: Given
    ) -> tuple[RunStatus, str]:
        """Return how a run ended that left commands (m,) and inputs (n_u, m), and why, if the status does not tell."""
        if not commands.size:
            return RunStatus.DONE, ""
        status = self._why(rest, given["rest_command"], commands[0], given["values"])
        runs_away = status is RunStatus.PULL_IN and ACTED_ON not in self.equations.signals
        fault = undefined_ahead(self.equations, rest, path, inputs[:, 0], given["values"])
        return status, fault or (NO_EQUILIBRIUM if runs_away else "")


def _run(
    status: RunStatus,
    outputs: list[np.ndarray],
    sensitivities: np.ndarray | None,
    watched: np.ndarray | None,
    fault: str = "",
) -> Run:
    readings = np.concatenate(outputs)
    return Run(
        status=status,
        outputs=readings,
        sensitivities=sensitivities,
        watched=watched,
        failed_at=None if status.ok else max(readings.size - 1, 0),
        advice=fault or status.value,
        further=np.empty((readings.size, 0)),
        further_slopes=np.empty((readings.size, 0, 0)),
    )


class Stepper:
    """A plant that is simulated sample by sample."""

    def __init__(
        self,
        sample: Sample,
        equations: Equations,
        rest: RestState,
        rest_command: float,
        reading: float,
        start: float,
        why: Callable[[float], RunStatus],
    ) -> None:
        self._sample, self._why = sample, why
        self._inputs = equations.held_inputs(rest_command)
        self._history, self._clock = equations.history, equations.sample_start
        self._x: Any = rest.x
        self._z: Any = rest.z
        self._held = rest.d
        self._reading, self._start, self._count = reading, start, 0
        self._status = RunStatus.DONE if rest.found else RunStatus.NO_REST

    @property
    def status(self) -> RunStatus:
        """Status of the run so far."""
        return self._status

    @property
    def time(self) -> float:
        """Clock time of `reading`, s."""
        return self._start + self._count * self._sample.sample_time

    @property
    def reading(self) -> float:
        """The present reading without noise, SI; after a failure, the last valid one."""
        if self._status is RunStatus.NO_REST:
            raise SimulationError(self._status.value)
        return self._reading

    def advance(self, command: float) -> RunStatus:
        """Hold a command for one sample. After a failure, the plant stays as it was before that sample."""
        if self._status.ok:
            inputs = self._inputs.copy()
            inputs[: 1 + self._history] = [command, *self._inputs[: self._history]]
            if self._clock is not None:
                inputs[self._clock] = self.time
            found = self._sample(self._x, self._z, self._held, inputs, self.time)
            if found is not None:
                self._x, self._z, self._reading = found
                self._inputs, self._count = inputs, self._count + 1
            else:
                self._status = self._why(command)
        return self._status
