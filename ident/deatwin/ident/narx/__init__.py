"""Polynomial NARX models: terms, estimators, one-step prediction and free run.

>>> from deatwin.ident.narx import NarxModel
>>> print(NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)^2": 0.3}, sample_time=1.0))
y(k) = 0.6 y(k-1) + 0.3 u(k-1)^2 + e(k)
"""

from deatwin.ident.narx.frols import Frols
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import OperatingRange
from deatwin.ident.narx.response import NarxResponse, ResponseStatus
from deatwin.ident.narx.svb import SvbNarx
from deatwin.ident.narx.terms import Term, TermTable, Variable, generate_terms
from deatwin.plant.recording import Experiment, Recording

__all__ = [
    "Experiment",
    "FitStatus",
    "Frols",
    "NarxIdentifier",
    "NarxModel",
    "NarxResponse",
    "OperatingRange",
    "Recording",
    "ResponseStatus",
    "SvbNarx",
    "Term",
    "TermTable",
    "Variable",
    "generate_terms",
]
