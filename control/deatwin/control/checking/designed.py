"""A controller from a design that the user brings: made, and held to what a check needs of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from deatwin.control.controllers.base import Controller
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.plant.errors import DeatwinError, ModelError

Design = Callable[..., Controller]
"""Takes the model as the controller sees it, and ``command_limits``."""

SAME = 1e-9
"""Operating inputs that differ by less, as a share of the range of the command, are one."""


class UndesignedError(ControlError):
    """A design finds no controller for the model: an answer to the check, not a mistake of the caller."""


def designed(design: Design, linear: LinearModel, command_limits: tuple[float, float]) -> Controller:
    """Design a controller on a model, and turn foreign exceptions into a ControlError."""
    try:
        controller = design(linear, command_limits=command_limits)
    except (ControlError, ModelError) as error:
        raise UndesignedError(f"no controller could be designed: {error}") from error
    except DeatwinError:
        raise
    except Exception as error:
        raise ControlError(f"the design {_name(design)} raised {type(error).__name__}: {error}") from error
    if not isinstance(controller, Controller):
        raise ControlError(
            f"the design {_name(design)} returned {type(controller).__name__}; it must return a Controller"
        )
    low, high = command_limits
    if abs(controller.operating_input - linear.operating_input) > SAME * (high - low):
        raise ControlError(
            f"the design is for the operating input {controller.operating_input:g}, not for {linear.operating_input:g}"
        )
    return controller


def _name(design: Design) -> str:
    """Name of a design for messages: that of the function, or of a callable object's class."""
    while isinstance(design, partial):
        design = design.func
    return str(getattr(design, "__name__", type(design).__name__))
