"""Identified models to controllers, and controllers to a verdict on the physics plant."""

from deatwin.control.checking.check import Check, check
from deatwin.control.checking.promise import LoopMargins, OperatingPoint
from deatwin.control.checking.verdict import Finding, Verdict
from deatwin.control.design.lambda_tuning import PiController, lambda_tuning
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.linear.narx import linearise, linearise_posterior
from deatwin.control.loop.closed_loop import ClosedLoop, closed_loop, sine_reference, step_reference
from deatwin.control.stability.excited import excited_band
from deatwin.control.stability.margins import Margins, margins

__all__ = [
    "Check",
    "ClosedLoop",
    "ControlError",
    "Finding",
    "LinearModel",
    "LinearStatus",
    "LoopMargins",
    "Margins",
    "OperatingPoint",
    "PiController",
    "Verdict",
    "check",
    "closed_loop",
    "excited_band",
    "lambda_tuning",
    "linearise",
    "linearise_posterior",
    "margins",
    "sine_reference",
    "step_reference",
]
