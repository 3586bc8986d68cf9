"""Simulate a sampled controller with the physics plant, and measure the closed loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import function, generator, instance, not_negative, of_plain_data, row, taking
from deatwin.control.controllers.base import Controller, require_clock
from deatwin.control.errors import ControlError
from deatwin.control.progress import Progress
from deatwin.ident.arguments import keep_read_only
from deatwin.plant.amplitudes import axis_label, written_amplitude
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, status_of
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig
from deatwin.plant.simulate import RunStatus, Stepper
from deatwin.plant.timeline import Timeline

_LEVEL = 5  # Least number of samples at one value in a level of a step reference
_NEWS = 100  # Number of samples between two calls of the progress callback
_LARGEST = 1e100  # Largest value of a signal, in any unit; its square is still finite
_AT_LIMIT = 1e-9  # Distance from a limit, as a share of the range, that counts as rounding of an inverse curve
_SERIES = ("timepts", "reference", "output", "measured", "command")


@dataclass(frozen=True, kw_only=True)
class Level:
    """A constant stretch of a step reference, as a range of samples of a run."""

    first: int  # Sample at which the reference leaves the previous level
    settled: int  # Sample at which it reaches this level
    stop: int  # Sample at which it leaves this level
    step: float  # Difference from the previous level, in the output's unit


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop(Described):
    """Signals of a closed-loop run on a plant, as `closed_loop` returns them, and measures such as the overshoot.

    Parameters
    ----------
    status : RunStatus
        Outcome of the run, with advice to the user. If the simulation failed, the arrays end at the last valid sample.
    timepts : ndarray, shape (n,)
        Time since the loop was closed, ascending, s.
    reference : ndarray, shape (n,)
        Desired output, in its unit.
    output : ndarray, shape (n,)
        Reading without noise at the time at which the command is chosen, in its unit.
    measured : ndarray, shape (n,)
        Reading with noise that the controller received at this time, in the output's unit.
    command : ndarray, shape (n,)
        Command that the controller chose from `measured` and held for one sample, in the input's unit.
    command_limits : (float, float)
        Least and largest command of the controller, in the input's unit.
    input_unit, output_unit : str
        Units of input and output.
    """

    status: RunStatus = field(metadata=status_of())
    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    reference: Array
    output: Array
    measured: Array
    command: Array
    command_limits: tuple[float, float]
    input_unit: str
    output_unit: str

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "run": several(lambda loop: loop.variables("time")),
        "command_min": attribute(of=lambda loop: loop.command_limits[0]),
        "command_max": attribute(of=lambda loop: loop.command_limits[1]),
        "rms_error": attribute(),
    }

    def __post_init__(self) -> None:
        keep_read_only(self, *_SERIES)
        for name in _SERIES:
            if (shape := getattr(self, name).shape) != (self.timepts.size,):
                raise ControlError(f"{name} of a run has the shape {shape}: it must be ({self.timepts.size},)")
        late = np.flatnonzero(~(np.diff(self.timepts) > 0.0))
        if late.size:
            at = int(late[0]) + 1
            raise ControlError(
                f"timepts[{at}] of a run is {self.timepts[at]:g} s: it must be later than {self.timepts[at - 1]:g} s"
            )

    @property
    def error(self) -> Array:
        """Reference minus noise-free output, shape (n,), in the output's unit."""
        return self.reference - self.output

    @property
    def rms_error(self) -> float:
        """Root mean square of `error`, in the output's unit; 0 for a run without samples."""
        return float(np.sqrt(np.mean(self.error**2))) if self.error.size else 0.0

    @property
    def saturated_share(self) -> float:
        """Share of the samples whose command is at a limit."""
        low, high = self.command_limits
        away = np.minimum(self.command - low, high - self.command)
        return float(np.mean(away <= _AT_LIMIT * (high - low))) if self.command.size else 0.0

    @property
    def effort(self) -> float:
        """Total variation of the command divided by the duration of the run, input unit per second."""
        if self.command.size < 2:
            return 0.0
        return float(np.abs(np.diff(self.command)).sum() / (self.timepts[-1] - self.timepts[0]))

    @property
    def levels(self) -> tuple[Level, ...]:
        """Constant stretches of a step reference, from the second one on."""
        still = np.flatnonzero(np.diff(self.reference) != 0.0)
        edges = np.concatenate([[-1], still, [self.reference.size - 1]]) + 1
        flat = [(int(a), int(b)) for a, b in pairwise(edges) if b - a >= _LEVEL]
        return tuple(
            Level(first=end, settled=start, stop=stop, step=float(self.reference[start] - self.reference[end - 1]))
            for (_, end), (start, stop) in pairwise(flat)
            if self.reference[start] != self.reference[end - 1]
        )

    @property
    def overshoot(self) -> float:
        """Largest amount by which the output overshoots a level of a step reference, as a share of the step."""
        over = [(self.output[v.first : v.stop] - self.reference[v.settled]) / v.step for v in self.levels]
        return max([0.0, *(float(share.max()) for share in over)])

    @property
    def steady_error(self) -> float:
        """Magnitude of the mean error in the last third of a level, as a share of the smallest step; the largest of all
        `levels`.
        """
        return self._late(lambda error: abs(float(error.mean())))

    @property
    def ripple(self) -> float:
        """Standard deviation of the error in the last third of a level, as a share of the smallest step; the largest of
        all `levels`.
        """
        return self._late(lambda error: float(error.std()))

    def _late(self, measure: Callable[[Array], float]) -> float:
        levels = self.levels
        if not levels:
            return 0.0
        smallest = min(abs(level.step) for level in levels)
        late = [self.error[v.stop - max((v.stop - v.settled) // 3, 1) : v.stop] for v in levels]
        return max(measure(error) for error in late) / smallest

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot reference and output over time, on `ax` or new axes."""
        axes = axes_or_new(ax)
        unit, size = written_amplitude(self.output_unit)
        axes.plot(self.timepts, self.measured / size, color="0.8", linewidth=0.8, label="simulated reading")
        axes.plot(self.timepts, self.reference / size, "--", label="reference")
        axes.plot(self.timepts, self.output / size, label="output")
        axes.set_xlabel("time (s)")
        axes.set_ylabel(axis_label("output", unit))
        axes.legend()
        return axes

    def variables(self, dimension: str, before: str = "") -> Variables:
        """Return the signals for `datasets.dataset` along the time `dimension`; `before` is a prefix of their names."""
        units = {"command": self.input_unit}
        return {
            before + name: (dimension, getattr(self, name), units.get(name, self.output_unit)) for name in _SERIES[1:]
        }

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `from_dict` rebuilds the run."""
        return {
            "status": self.status.name.lower(),
            "command_limits": list(self.command_limits),
            "input_unit": self.input_unit,
            "output_unit": self.output_unit,
            **{name: getattr(self, name).tolist() for name in _SERIES},
        }

    @classmethod
    @of_plain_data(ControlError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild a run from the `data` of `to_dict`; ControlError if a value's square overflows."""
        low, high = data["command_limits"]
        series = {name: np.array(data[name], dtype=np.float64) for name in _SERIES}
        for name, values in series.items():
            if values.size and not np.abs(values).max() <= _LARGEST:
                raise ControlError(f"{name} of a run holds a value beyond {_LARGEST:g}; it is damaged")
        return cls(
            status=RunStatus[data["status"].upper()],
            command_limits=(float(low), float(high)),
            input_unit=str(data["input_unit"]),
            output_unit=str(data["output_unit"]),
            **series,
        )


@taking(
    plant=instance(Plant),
    controller=instance(Controller),
    reference=row,
    rng=generator,
    settle=not_negative,
    progress=function,
)
def closed_loop(
    plant: Plant,
    controller: Controller,
    reference: ArrayLike,
    *,
    rng: np.random.Generator,
    settle: float = 2.0,
    progress: Progress | None = None,
) -> ClosedLoop:
    """Simulate a controller in closed loop with a plant, the physics model of the actuator.

    The rig's start procedure brings the plant from rest to the operating input, at which the plant settles. Then, in
    each sample, the loop takes a reading, chooses a command, and holds the command for one sample. If the rig has a
    measuring chain, reading and command pass through this chain. Otherwise the sensor's noise is added to the reading.

    Parameters
    ----------
    plant : Plant
        Plant that stands for the actuator.
    controller : Controller
        Controller with the plant's sampling time.
    reference : array_like, shape (n,)
        Desired output, in its unit.
    rng : numpy.random.Generator
        Random generator for the sensor noise.
    settle : float
        Time at the operating input before the loop is closed, s.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Raises
    ------
    ControlError
        If an argument has the wrong type, controller and plant have different sampling times, or the reference is not a
        one-dimensional array of finite numbers.
    """
    rig, wanted = plant.rig, np.asarray(reference, dtype=np.float64)
    require_clock(controller, "the rig", rig.sample_time)
    stepper = at_operating_point(plant, controller.operating_input, max(round(settle / rig.sample_time), 1))
    series = np.empty((3, wanted.size))
    memory, count = controller.start(), 0
    before = stepper.reading if stepper.status.ok else 0.0
    while stepper.status.ok and count < wanted.size:
        measured = _measured(rig, before, stepper.reading, rng)
        command, memory = controller.command(wanted[count], measured, memory)
        series[:, count] = stepper.reading, measured, command
        before = stepper.reading
        stepper.advance(float(command if rig.chain is None else rig.chain.applied(command)))
        count += 1
        if progress is not None and (count % _NEWS == 0 or count == wanted.size):
            progress(count / wanted.size)
    output, measured_all, commands = series[:, :count]
    return ClosedLoop(
        status=stepper.status,
        timepts=rig.sample_time * np.arange(count, dtype=np.float64),
        reference=wanted[:count],
        output=output,
        measured=measured_all,
        command=commands,
        command_limits=(controller.command_min, controller.command_max),
        input_unit=rig.input_unit,
        output_unit=rig.output_unit,
    )


def _measured(rig: Rig, before: float, now: float, rng: np.random.Generator) -> float:
    """Return the reading with sensor noise, from two successive samples."""
    if rig.chain is None:
        return now + rig.noise * float(rng.standard_normal())
    return float(rig.chain.record([before, now], rng, sample_time=rig.sample_time)[-1])


def approach(plant: Plant, command: float, count: int) -> Timeline:
    """Return the commands of a plant's start procedure, followed by samples of the operating input."""
    still = Recording.from_arrays(np.full(count, command), np.zeros(count), plant.rig.sample_time)
    return plant.timeline(Experiment(recordings=(still,)))


def at_operating_point(plant: Plant, command: float, count: int) -> Stepper:
    """Return the plant after its start procedure and further samples of the operating input."""
    timeline = approach(plant, command, count)
    stepper = plant.simulator.stepper(
        plant.free_values,
        rest_command=plant.rig.start.rest_command,
        start=timeline.start,
        sample_time=timeline.sample_time,
    )
    for value in timeline.commands:
        if not stepper.advance(float(value)).ok:
            break
    return stepper
