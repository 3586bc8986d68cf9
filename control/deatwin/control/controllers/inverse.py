"""A controller behind the inverse of the actuator's static curve, which makes the loop's static gain uniform."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import instance, numbers, require_fields, taking
from deatwin.control.controllers.base import Controller, require_clock, require_factor
from deatwin.control.controllers.law import Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.errors import ControlError
from deatwin.ident.arguments import keep_read_only
from deatwin.plant.amplitudes import amount
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, coordinate, gain_unit, variable
from deatwin.plant.drawing import Axes, axes_or_new

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator


_CELLS = 32  # Number of points of the table in each piece of the cubic
_STEPS = 60  # Largest number of steps: bisection reaches rounding in 60, Newton's method in two or three


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticCurve(Described):
    """Output at rest as a strictly monotone function of the constant input, with the inverse function.

    Between the given points, the curve is a monotone cubic interpolant (Fritsch and Carlson). Beyond the first and last
    point, the curve is constant.

    Parameters
    ----------
    inputs : ndarray, shape (n,)
        Constant inputs, increasing, in the input's unit.
    outputs : ndarray, shape (n,)
        Outputs at rest, strictly increasing or strictly decreasing, in the output's unit.
    input_unit, output_unit : str
        Units of input and output.

    Raises
    ------
    ControlError
        If there are fewer than two points, a value is not finite, or inputs or outputs are not strictly monotone.

    References
    ----------
    Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246 (monotone piecewise cubic interpolation).
    """

    inputs: Array = field(
        metadata=coordinate("input", name="input", unit=attrgetter("input_unit"), about="constant input")
    )
    outputs: Array = field(
        metadata=variable("input", name="output", unit=attrgetter("output_unit"), about="output at rest")
    )
    input_unit: str = ""
    output_unit: str = ""

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "slope": variable("input", of=lambda curve: curve.slope(curve.inputs), unit=gain_unit, about="static gain")
    }

    def __post_init__(self) -> None:
        require_fields(self, inputs=numbers, outputs=numbers)
        keep_read_only(self, "inputs", "outputs")
        if self.inputs.ndim != 1 or self.inputs.size < 2 or self.outputs.shape != self.inputs.shape:
            raise ControlError("a static curve needs at least two points, an output to each input")
        if not (np.all(np.isfinite(self.inputs)) and np.all(np.isfinite(self.outputs))):
            raise ControlError("every point of a static curve must be finite")
        if not np.all(np.diff(self.inputs) > 0.0):
            raise ControlError("the inputs of a static curve must increase")
        steps = np.diff(self.outputs)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            turn = int(np.argmax(np.sign(steps) != np.sign(steps[0])))
            raise ControlError(
                f"the static curve turns at {amount(f'{self.inputs[turn]:.4g}', self.input_unit)}: it cannot be "
                "inverted there; choose a range of the command on one side of it"
            )

    @cached_property
    def _forward(self) -> PchipInterpolator:
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self.inputs, self.outputs)

    @cached_property
    def _table(self) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return inputs and outputs of many points, sorted by output, and the cubic piece at each point."""
        shares = np.arange(_CELLS) / _CELLS
        inputs = np.append((self.inputs[:-1, None] + np.diff(self.inputs)[:, None] * shares).ravel(), self.inputs[-1])
        pieces = np.repeat(np.arange(self.inputs.size - 1), _CELLS)
        if self.outputs[-1] < self.outputs[0]:
            inputs, pieces = inputs[::-1], pieces[::-1]
        return inputs, np.maximum.accumulate(self._forward(inputs)), pieces

    @taking(value=numbers)
    def output(self, value: ArrayLike) -> Array:
        """Return the outputs at rest for constant inputs `value`; inputs beyond the curve's ends are clipped."""
        return np.asarray(self._forward(np.clip(value, self.inputs[0], self.inputs[-1])), dtype=np.float64)

    @taking(value=numbers)
    def slope(self, value: ArrayLike) -> Array:
        """Return the static gains, output unit per input unit, at constant inputs `value`."""
        return np.asarray(self._forward(np.clip(value, self.inputs[0], self.inputs[-1]), 1), dtype=np.float64)

    @taking(value=numbers)
    def input(self, value: ArrayLike) -> Array:
        """Return the constant inputs that hold the outputs `value`; outputs beyond the curve's ends are clipped."""
        inputs, outputs, pieces = self._table
        wanted = np.clip(np.asarray(value, dtype=np.float64), outputs[0], outputs[-1])
        cell = np.clip(np.searchsorted(outputs, wanted, side="right") - 1, 0, pieces.size - 1)
        left, right = inputs[cell], inputs[cell + 1]  # The output is too small at the left and too large at the right
        begin, (c3, c2, c1, c0) = self.inputs[pieces[cell]], self._forward.c[:, pieces[cell]]
        found = np.interp(wanted, outputs, inputs)
        for _ in range(_STEPS):
            s = found - begin
            gap = wanted - (((c3 * s + c2) * s + c1) * s + c0)
            slope = (3.0 * c3 * s + 2.0 * c2) * s + c1
            left, right = np.where(gap > 0.0, found, left), np.where(gap < 0.0, found, right)
            moved = found + np.divide(gap, slope, out=np.zeros_like(s), where=slope != 0.0)
            inside = (moved - left) * (moved - right) <= 0.0  # else outside the bracket, which is halved
            moved = np.where(inside, moved, 0.5 * (left + right))
            done, found = np.all(np.abs(moved - found) <= self._resolution), moved
            if done:
                break
        return np.where(np.isnan(wanted), np.nan, found)

    @cached_property
    def _resolution(self) -> float:
        """Return the rounding error of an input, in its unit."""
        return 2.0 * float(np.finfo(np.float64).eps * np.abs(self.inputs).max())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the output at rest over the constant input, on `ax` or new axes."""
        axes = axes_or_new(ax)
        inputs, outputs, _ = self._table
        axes.plot(inputs, outputs)
        axes.set_xlabel(f"constant input ({self.input_unit})" if self.input_unit else "constant input")
        axes.set_ylabel(f"output at rest ({self.output_unit})" if self.output_unit else "output at rest")
        return axes


_INNER = ("name", "operating_input", "command_min", "command_max")
"""Fields that differ in the inner feedback, because its command is a desired output."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseController(Controller):
    """A controller that adds feedback to the reference and converts the sum to a command by the inverse static curve.

    The feedback only has to correct what the curve does not describe: dynamics, drift and hysteresis. Because the
    inverse cancels the slope of the curve, the loop gain is the same at all operating points.

    Parameters
    ----------
    name, sample_time, operating_input, operating_output, command_min, command_max, closed_loop_time
        See `Controller`.
    feedback : LinearController
        Linear controller that computes this sum, in the output's unit. Its law must therefore contain the reference,
        either unfiltered (`Law.feedforward` with a gain of one) or filtered (`with_dynamics`).
    curve : StaticCurve
        Static curve of the actuator, from constant input to output at rest.

    Raises
    ------
    ControlError
        As in `Controller`, or if the feedback has another sampling time.
    """

    feedback: LinearController
    curve: StaticCurve

    kind = "inverse"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_fields(self, feedback=instance(LinearController), curve=instance(StaticCurve))
        require_clock(self.feedback, "the inverse controller around it", self.sample_time)

    @property
    def states(self) -> int:
        """Number of states."""
        return self.feedback.states

    def start(self) -> Array:
        """State at the moment at which the loop is closed: zeros, shape (states,)."""
        return self.feedback.start()

    def command(self, reference: ArrayLike, reading: ArrayLike, state: Array) -> tuple[Array, Array]:
        wanted, after = self.feedback.command(reference, reading, state)
        return np.clip(self.curve.input(wanted), self.command_min, self.command_max), after

    def local(self, operating_input: float) -> Law:
        """Return the linear law near `operating_input`: that of the feedback, divided by the slope of the curve."""
        return self.feedback.law.scaled(1.0 / float(self.curve.slope(operating_input)))

    def scaled(self, factor: float) -> Self:
        require_factor(factor)
        return replace(self, feedback=replace(self.feedback, law=self.feedback.law.with_feedback(factor)))

    def details(self) -> dict[str, Any]:
        feedback, curve = self.feedback, self.curve
        return {
            "feedback": {**feedback.details(), **{name: getattr(feedback, name) for name in _INNER}},
            "curve": {
                "inputs": curve.inputs.tolist(),
                "outputs": curve.outputs.tolist(),
                "input_unit": curve.input_unit,
                "output_unit": curve.output_unit,
            },
        }

    @classmethod
    def from_details(cls, common: Mapping[str, Any], details: Mapping[str, Any]) -> Self:
        inner = details["feedback"]
        wanted = {**common, **{name: inner[name] for name in _INNER}}
        feedback = LinearController.from_details(wanted, inner)
        return cls(**common, feedback=feedback, curve=StaticCurve(**details["curve"]))
