"""Base class of sampled controllers: a law with command limits, evaluated for one loop or many at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import finite, number, positive, require_fields
from deatwin.control.controllers.law import Law
from deatwin.control.errors import ControlError
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Rebuilt

if TYPE_CHECKING:
    from control import NonlinearIOSystem


@dataclass(frozen=True, kw_only=True, eq=False)
class Controller(Rebuilt, ABC):
    """Base class of sampled controllers with a limited command.

    Parameters
    ----------
    name : str
        Name for users, such as ``PI``.
    sample_time : float
        Sampling time of the model on which the controller was designed, s.
    operating_input : float
        Command about which the loop is closed, in its unit.
    operating_output : float
        Output at rest under the operating input, in the output's unit.
    command_min, command_max : float
        Least and largest command, in its unit.
    closed_loop_time : float
        Time constant for which the closed loop was designed, s. `check` derives its references and the length of its
        runs from this time. Only in a `ScheduledController` does the command depend on this time.

    Raises
    ------
    ControlError
        If a value is not finite, a time is not positive, or the operating input does not lie between the limits.
    """

    name: str
    sample_time: float
    operating_input: float
    operating_output: float
    command_min: float
    command_max: float
    closed_loop_time: float

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        require_fields(
            self,
            sample_time=positive,
            operating_input=finite,
            operating_output=finite,
            command_min=finite,
            command_max=finite,
            closed_loop_time=positive,
        )
        if not self.command_min < self.operating_input < self.command_max:
            raise ControlError(
                f"the operating input {self.operating_input:g} must lie between the limits of the command, "
                f"{self.command_min:g} and {self.command_max:g}"
            )

    @property
    @abstractmethod
    def states(self) -> int:
        """Number of states."""

    @abstractmethod
    def start(self) -> Array:
        """State at the moment at which the loop is closed, shape (states,)."""

    @abstractmethod
    def command(self, reference: ArrayLike, reading: ArrayLike, state: Array) -> tuple[Array, Array]:
        """Compute the command of one sample, for one loop or for many at once.

        Parameters
        ----------
        reference, reading : array_like, shape batch
            Reference and reading, in the output's unit; batch is () for one loop.
        state : ndarray, shape (states, *batch)
            State of the controller before the sample.

        Returns
        -------
        command : ndarray, shape batch
            Command within its limits, in the input's unit.
        state : ndarray, shape (states, *batch)
            State of the controller after the sample.
        """

    @abstractmethod
    def local(self, operating_input: float) -> Law:
        """Return the linear law for small deviations from a constant `operating_input`, in the input's unit."""

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """Return the controller with its loop gain multiplied by `factor`; the factor must be finite and not 0."""

    @abstractmethod
    def details(self) -> dict[str, Any]:
        """Plain data of the fields that only this kind of controller has."""

    @classmethod
    @abstractmethod
    def from_details(cls, common: Mapping[str, Any], details: Mapping[str, Any]) -> Self:
        """Rebuild a controller from the common fields and its `details`.

        Parameters
        ----------
        common : mapping
            Fields that every kind of controller has.
        details : mapping
            Plain data that `details` returned.
        """

    def to_control(self) -> NonlinearIOSystem:
        """Return a system of python-control from reference and reading to the command within its limits."""
        import control

        def update(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
            return self.command(u[0], u[1], np.asarray(x))[1]

        def output(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
            return np.atleast_1d(self.command(u[0], u[1], np.asarray(x))[0])

        return control.nlsys(
            update,
            output,
            dt=self.sample_time,
            states=self.states,
            name=self.name,
            inputs=["reference", "reading"],
            outputs=["command"],
        )


def room_of(controller: Controller) -> float:
    """Return the distance from the operating input to the nearer limit of the command, in its unit."""
    return min(controller.operating_input - controller.command_min, controller.command_max - controller.operating_input)


def require_factor(factor: float) -> None:
    """Raise ControlError unless a factor for a loop gain is finite and not zero."""
    number(factor, "factor")
    if not isfinite(factor) or factor == 0.0:
        raise ControlError(f"a loop gain cannot be multiplied by {factor:g}: the factor must be finite and not 0")


def require_clock(controller: Controller, other: str, sample_time: float) -> None:
    """Raise ControlError unless a controller runs at the `sample_time` (s) of what it controls."""
    if abs(controller.sample_time / sample_time - 1.0) > 1e-6:
        raise ControlError(f"the controller runs every {controller.sample_time:g} s, {other} every {sample_time:g} s")
