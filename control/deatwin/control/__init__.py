"""Identified models to controllers, and controllers to a verdict on the physics plant."""

from deatwin.control.checking.check import check
from deatwin.control.checking.result import Check
from deatwin.control.checking.rows import MarginRow, OperatingPoint
from deatwin.control.checking.specification import Limit, Specification, Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.document import controller_from_dict, controller_to_dict
from deatwin.control.controllers.inverse import InverseController, StaticCurve
from deatwin.control.controllers.law import Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.design.feedforward import InverseFilter, inverse_filter, with_dynamics
from deatwin.control.design.hinf import hinf
from deatwin.control.design.inverse import static_curve, with_inverse
from deatwin.control.design.lambda_tuning import lambda_tuning, lambda_tuning_pid
from deatwin.control.design.loop_shaping import loop_shaping, loop_shaping_pid
from deatwin.control.design.lqg import lqg
from deatwin.control.design.pid import PidGains, pid
from deatwin.control.design.scheduling import scheduled
from deatwin.control.errors import ControlError, MissingPackageError
from deatwin.control.interop.from_control import from_control
from deatwin.control.interop.narx_system import past_state
from deatwin.control.interop.responses import Frd, linear_frd, to_frd
from deatwin.control.interop.systems import in_loop, rest_state_of, to_nlsys
from deatwin.control.linear.family import LinearFamily, linearise_many
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import draw_plants, linearise_plant, linearise_plants
from deatwin.control.linear.schedule import GainSchedule, VaryingLinear, gain_schedule, linearise_along
from deatwin.control.loop.closed_loop import ClosedLoop, closed_loop
from deatwin.control.loop.predicted import PredictedLoop, predict_loop
from deatwin.control.loop.references import sine_reference, step_reference, tone_reference
from deatwin.control.loop.sine_response import SineResponse, sine_response
from deatwin.control.stability.bands import MarginBand, UncertainMargin, band_margins
from deatwin.control.stability.limit_cycles import LimitCycle, LimitCycles, limit_cycles
from deatwin.control.stability.margins import Margins, margins
from deatwin.control.stability.polynomials import in_series

__all__ = [
    "Check",
    "ClosedLoop",
    "ControlError",
    "Controller",
    "Finding",
    "Frd",
    "GainSchedule",
    "InverseController",
    "InverseFilter",
    "Law",
    "Limit",
    "LimitCycle",
    "LimitCycles",
    "LinearController",
    "LinearFamily",
    "LinearModel",
    "LinearStatus",
    "MarginBand",
    "MarginRow",
    "Margins",
    "MissingPackageError",
    "OperatingPoint",
    "PidGains",
    "PredictedLoop",
    "ScheduledController",
    "SineResponse",
    "Specification",
    "StaticCurve",
    "UncertainMargin",
    "VaryingLinear",
    "Verdict",
    "band_margins",
    "check",
    "closed_loop",
    "controller_from_dict",
    "controller_to_dict",
    "draw_plants",
    "from_control",
    "gain_schedule",
    "hinf",
    "in_loop",
    "in_series",
    "inverse_filter",
    "lambda_tuning",
    "lambda_tuning_pid",
    "limit_cycles",
    "linear_frd",
    "linearise",
    "linearise_along",
    "linearise_many",
    "linearise_plant",
    "linearise_plants",
    "loop_shaping",
    "loop_shaping_pid",
    "lqg",
    "margins",
    "past_state",
    "pid",
    "predict_loop",
    "rest_state_of",
    "scheduled",
    "sine_reference",
    "sine_response",
    "static_curve",
    "step_reference",
    "to_frd",
    "to_nlsys",
    "tone_reference",
    "with_dynamics",
    "with_inverse",
]
