"""Identified models to controllers, and controllers to a verdict on the physics plant."""

from deatwin.control.check import Check, check
from deatwin.control.design import ControlError, PiController, lambda_tuning
from deatwin.control.linearise import LinearModel, LinearStatus, linearise, linearise_posterior
from deatwin.control.loop import ClosedLoop, closed_loop, sine_reference, step_reference
from deatwin.control.margins import Margins, excited_band, margins
from deatwin.control.promise import LoopMargins, OperatingPoint
from deatwin.control.verdict import Finding, Verdict

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
