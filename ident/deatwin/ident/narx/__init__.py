"""Polynomial NARX models: terms, estimators, one-step prediction and free run.

>>> from deatwin.ident.narx import NarxModel
>>> print(NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)^2": 0.3}, sample_time=1.0))
y(k) = 0.6 y(k-1) + 0.3 u(k-1)^2 + e(k)
"""

from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.estimate import Bayesian, LeastSquares, Ridge, TotalLeastSquares
from deatwin.ident.narx.excited import Excitation, excitation, excited_band
from deatwin.ident.narx.export import narx_source
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.frols import Frols
from deatwin.ident.narx.grow import Grow, GrowStep
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.posterior import PredictiveBand, ThetaPosterior, free_run_band, one_step_band
from deatwin.ident.narx.recursive import Rls, ThetaSmoother
from deatwin.ident.narx.refine import refine
from deatwin.ident.narx.reliance import Reliance, assess_reliance, assessed, hold_out
from deatwin.ident.narx.residual import Residual, free_run_residual
from deatwin.ident.narx.residual_tests import CorrelationTest
from deatwin.ident.narx.response import NarxResponse, ResponseStatus
from deatwin.ident.narx.robust import robust
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.semp_search import SempStep
from deatwin.ident.narx.shapes import register_function
from deatwin.ident.narx.svb import PruningStep, SvbNarx
from deatwin.ident.narx.terms import Term, TermTable, Variable, generate_terms
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.ident.narx.unstable import Unstable
from deatwin.ident.narx.validate import Validation, ValidationStatus, validate
from deatwin.plant.recording import Experiment, Recording

__all__ = [
    "Bayesian",
    "CorrelationTest",
    "Excitation",
    "Experiment",
    "FitStatus",
    "Fixed",
    "Frols",
    "Grow",
    "GrowStep",
    "Lasso",
    "LeastSquares",
    "Narmax",
    "NarxIdentifier",
    "NarxModel",
    "NarxResponse",
    "OperatingRange",
    "PredictiveBand",
    "PruningStep",
    "Recording",
    "Reliance",
    "Residual",
    "ResponseStatus",
    "Ridge",
    "Rls",
    "Semp",
    "SempStep",
    "SvbNarx",
    "Term",
    "TermTable",
    "ThetaPosterior",
    "ThetaSmoother",
    "ThetaTrajectory",
    "TotalLeastSquares",
    "Unstable",
    "Validation",
    "ValidationStatus",
    "Variable",
    "assess_reliance",
    "assessed",
    "excitation",
    "excited_band",
    "free_run_band",
    "free_run_residual",
    "generate_terms",
    "hold_out",
    "narx_source",
    "one_step_band",
    "refine",
    "register_function",
    "robust",
    "validate",
]
