"""Identified models to controllers, and controllers to a verdict on the physics plant."""

from deatwin.control.checking.check import check
from deatwin.control.checking.operating import OperatingPoint
from deatwin.control.checking.result import Check
from deatwin.control.checking.rows import MarginRow
from deatwin.control.checking.specification import Limit, Specification, Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.inverse import InverseController, StaticCurve
from deatwin.control.controllers.law import Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.design.lambda_tuning import lambda_tuning
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.linear.narx import linearise, linearise_posterior
from deatwin.control.loop.closed_loop import ClosedLoop, closed_loop
from deatwin.control.loop.predicted import PredictedLoop, predict_loop
from deatwin.control.loop.references import sine_reference, step_reference, tone_reference
from deatwin.control.loop.residual import Residual, free_run_residual
from deatwin.control.stability.excited import excited_band
from deatwin.control.stability.margins import Margins, margins

__all__ = [
    "Check",
    "ClosedLoop",
    "ControlError",
    "Controller",
    "Finding",
    "InverseController",
    "Law",
    "Limit",
    "LinearController",
    "LinearModel",
    "LinearStatus",
    "MarginRow",
    "Margins",
    "OperatingPoint",
    "PredictedLoop",
    "Residual",
    "ScheduledController",
    "Specification",
    "StaticCurve",
    "Verdict",
    "check",
    "closed_loop",
    "excited_band",
    "free_run_residual",
    "lambda_tuning",
    "linearise",
    "linearise_posterior",
    "margins",
    "predict_loop",
    "sine_reference",
    "step_reference",
    "tone_reference",
]
