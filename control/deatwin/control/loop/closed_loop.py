"""A sampled controller around the physics plant: references, closed loop, and what is measured on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.control.design.lambda_tuning import PiController
from deatwin.control.errors import ControlError
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.simulate import RunStatus, Stepper

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ClosedLoop", "closed_loop", "sine_reference", "step_reference"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_LEVELS = (0.0, 1.0, 0.0, -1.0, 0.0)
"""Levels of the step reference, in amplitudes; the first is where the loop closes."""
_NEWS = 100  # samples between two calls of progress
_SERIES = ("timepts", "reference", "output", "measured", "command")


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop:
    """A run of the closed loop on the physics plant.

    Parameters
    ----------
    status : RunStatus
        How it ended; its text is the advice. After a failure only the valid samples are here.
    timepts : ndarray, shape (n,)
        Time since the loop was closed, s.
    reference : ndarray, shape (n,)
        In the output's unit.
    output : ndarray, shape (n,)
        Reading without the sensor's noise, at the instant at which the command is chosen, in its unit.
    measured : ndarray, shape (n,)
        Reading with noise, which the controller saw, in the output's unit.
    command : ndarray, shape (n,)
        Chosen at that instant and held until the next, in the input's unit.
    command_limits : (float, float)
        Of the controller, in the input's unit.
    input_unit, output_unit : str
        Units.
    """

    status: RunStatus
    timepts: Array
    reference: Array
    output: Array
    measured: Array
    command: Array
    command_limits: tuple[float, float]
    input_unit: str
    output_unit: str

    def __post_init__(self) -> None:
        for name in _SERIES:
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)

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
        return float(np.mean((self.command <= low) | (self.command >= high))) if self.command.size else 0.0

    @property
    def effort(self) -> float:
        """Mean path of the command, input unit by second."""
        if self.command.size < 2:
            return 0.0
        return float(np.abs(np.diff(self.command)).sum() / (self.timepts[-1] - self.timepts[0]))

    @property
    def plateaus(self) -> tuple[slice, ...]:
        """Samples of each level of a step reference that the run lived through, without the first level."""
        changes = np.flatnonzero(np.diff(self.reference)) + 1
        edges = [*changes.tolist(), self.reference.size]
        return tuple(slice(first, last) for first, last in pairwise(edges))

    @property
    def overshoot(self) -> float:
        """Largest excursion beyond a new level of a step reference, as a share of its step."""
        shares = [0.0]
        for part in self.plateaus:
            step = self.reference[part.start] - self.reference[part.start - 1]
            shares.append(float((-self.error[part] / step).max()))
        return max(shares)

    @property
    def steady_error(self) -> float:
        """Largest mean error over the last third of a level, as a share of the smallest step."""
        return self._late(lambda error: abs(float(error.mean())))

    @property
    def ripple(self) -> float:
        """Largest rms motion over the last third of a level, as a share of the smallest step."""
        return self._late(lambda error: float(error.std()))

    def _late(self, measure: Callable[[Array], float]) -> float:
        parts = self.plateaus
        if not parts:
            return 0.0
        smallest = min(abs(float(self.reference[p.start] - self.reference[p.start - 1])) for p in parts)
        late = [self.error[p.stop - max((p.stop - p.start) // 3, 1) : p.stop] for p in parts]
        return max(measure(error) for error in late) / smallest

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw reference and output over time.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        axes.plot(self.timepts, self.measured, color="0.8", linewidth=0.8, label="measured")
        axes.plot(self.timepts, self.reference, "--", label="reference")
        axes.plot(self.timepts, self.output, label="output")
        axes.set_xlabel("time (s)")
        axes.set_ylabel(f"output ({self.output_unit})" if self.output_unit else "output")
        axes.legend()
        return axes

    def to_dict(self) -> dict[str, Any]:
        """Plain data from which `from_dict` makes the same run."""
        return {
            "status": self.status.name.lower(),
            "command_limits": list(self.command_limits),
            "input_unit": self.input_unit,
            "output_unit": self.output_unit,
            **{name: getattr(self, name).tolist() for name in _SERIES},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The run that `to_dict` described.

        Parameters
        ----------
        data : mapping
            Plain data.

        Returns
        -------
        ClosedLoop
        """
        low, high = data["command_limits"]
        return cls(
            status=RunStatus[data["status"].upper()], command_limits=(float(low), float(high)),
            input_unit=str(data["input_unit"]), output_unit=str(data["output_unit"]),
            **{name: np.array(data[name], dtype=np.float64) for name in _SERIES},
        )  # fmt: skip


def step_reference(centre: float, amplitude: float, plateau: int) -> Array:
    """Steps up, back, down and back.

    Parameters
    ----------
    centre, amplitude : float
        In the output's unit.
    plateau : int
        Samples of each level.

    Returns
    -------
    ndarray, shape (5 * plateau,)
        In the output's unit; the first level is the centre.

    Examples
    --------
    >>> step_reference(1.0, 0.5, 1).tolist()
    [1.0, 1.5, 1.0, 0.5, 1.0]
    """
    return centre + amplitude * np.repeat(_LEVELS, plateau)


def sine_reference(
    centre: float, amplitude: float, frequency_Hz: float, sample_time: float, periods: int
) -> Array:
    """A sine about an operating point.

    Parameters
    ----------
    centre, amplitude : float
        In the output's unit.
    frequency_Hz : float
        Hz.
    sample_time : float
        s.
    periods : int
        Number of periods, rounded to whole samples.

    Returns
    -------
    ndarray, shape (n,)
        In the output's unit.
    """
    count = round(periods / (frequency_Hz * sample_time))
    return np.asarray(centre + amplitude * np.sin(2 * np.pi * frequency_Hz * sample_time * np.arange(count)))


def closed_loop(
    plant: Plant,
    controller: PiController,
    reference: Array,
    *,
    rng: np.random.Generator,
    settle: float = 2.0,
    progress: Progress | None = None,
) -> ClosedLoop:
    """Close a controller around the physics plant.

    The plant goes from rest to the operating input by the rig's start procedure, stays there, and then
    answers the controller sample by sample: read with noise, choose a command, hold it for a sample.

    Parameters
    ----------
    plant : Plant
        The actuator.
    controller : PiController
        With the plant's sample time.
    reference : ndarray, shape (n,)
        Wanted output, in its unit.
    rng : numpy.random.Generator
        Source of the sensor's noise.
    settle : float
        Time at the operating input between the start procedure and the closing of the loop, s.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    ClosedLoop

    Raises
    ------
    ControlError
        If controller and plant have different sample times.
    """
    rig = plant.rig
    if abs(controller.sample_time / rig.sample_time - 1.0) > 1e-6:
        raise ControlError(
            f"the controller works every {controller.sample_time:g} s, the rig every {rig.sample_time:g} s"
        )
    stepper = _at_operating_point(plant, controller.operating_input, max(round(settle / rig.sample_time), 1))
    noise = rig.noise * rng.standard_normal(reference.size)
    series = np.empty((3, reference.size))
    memory, count = 0.0, 0
    while stepper.status.ok and count < reference.size:
        measured = stepper.reading + noise[count]
        command, memory = controller.command(float(reference[count] - measured), memory)
        series[:, count] = stepper.reading, measured, command
        stepper.advance(command)
        count += 1
        if progress is not None and count % _NEWS == 0:
            progress(count / reference.size)
    output, measured_all, commands = series[:, :count]
    return ClosedLoop(
        status=stepper.status, timepts=rig.sample_time * np.arange(count, dtype=np.float64),
        reference=reference[:count], output=output, measured=measured_all, command=commands,
        command_limits=(controller.command_min, controller.command_max),
        input_unit=rig.input_unit, output_unit=rig.output_unit,
    )  # fmt: skip


def _at_operating_point(plant: Plant, command: float, count: int) -> Stepper:
    """The plant after its start procedure and `count` further samples of the operating input."""
    still = Recording.from_arrays(np.full(count, command), np.zeros(count), plant.rig.sample_time)
    timeline = plant.timeline(Experiment(recordings=(still,)))
    stepper = plant.simulator.stepper(
        plant.free_values, rest_command=plant.rig.start.rest_command, start=timeline.start,
        sample_time=timeline.sample_time,
    )  # fmt: skip
    for value in timeline.commands:
        if not stepper.advance(float(value)).ok:
            break
    return stepper
