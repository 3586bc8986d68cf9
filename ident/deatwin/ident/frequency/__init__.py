"""Frequency-domain analysis of NARX models: equilibria, removal of the operating point, frequency responses."""

from deatwin.ident.frequency.dc import Equilibrium, LinearPart, equilibrium, linear_part, remove_dc
from deatwin.ident.frequency.gfrf import Band, FrequencyResponse, FrequencyStatus, gfrf

__all__ = [
    "Band",
    "Equilibrium",
    "FrequencyResponse",
    "FrequencyStatus",
    "LinearPart",
    "equilibrium",
    "gfrf",
    "linear_part",
    "remove_dc",
]
